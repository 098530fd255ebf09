"""The metrics, one a module, and their registry."""
