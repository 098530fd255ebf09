"""Folders of runs and grids on disk, their tables, and which of them may be replaced."""
