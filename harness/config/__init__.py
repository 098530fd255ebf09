"""A run's configuration: what it may hold, and how its layers become one."""
