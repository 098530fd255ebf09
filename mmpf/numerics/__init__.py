"""Arrays, compiled kernels, random numbers and threads."""
