"""Traffic that SUMO drives."""
