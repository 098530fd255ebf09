"""Arrays, random numbers and threads."""
