"""Driver models learned from trajectories."""
