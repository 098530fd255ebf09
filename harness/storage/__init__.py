"""What lies on disk: the folders of runs and grids, their tables, and who may replace them."""
