"""Facts about a run's vehicles and tracks that all metrics share."""
