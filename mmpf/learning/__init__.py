"""Learning a Gaussian-mixture driver model from recorded trajectories."""
