"""What is found out about a run's vehicles and tracks once, for all metrics."""
