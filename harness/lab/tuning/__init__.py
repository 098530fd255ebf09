"""The search for each tracker's settings on tuning seeds."""
