"""Whether one run, or grid of runs, is better or worse than another."""
