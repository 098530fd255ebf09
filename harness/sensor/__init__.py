"""The simulated sensor: what the ego vehicle can detect past the other vehicles."""
