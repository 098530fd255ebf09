"""A run's configuration: its fields, and how its layers are merged."""
