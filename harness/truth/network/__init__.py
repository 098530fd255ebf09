"""Road networks: their files, roads, demands and drivers."""
