"""Training of the behaviour models: recorded traffic, samples, fits and their cards."""
