"""The drivers that come along."""
