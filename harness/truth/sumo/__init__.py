"""Traffic that SUMO simulates."""
