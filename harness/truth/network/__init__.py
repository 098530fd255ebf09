"""Road networks: files, roads, demands and drivers."""
