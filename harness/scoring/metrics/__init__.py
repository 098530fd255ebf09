"""The metrics, one a file, and their registry."""
