"""SUMO networks that travel with the package, one folder each."""
