"""Co-simulation that evaluates multi-vehicle tracking through occlusion: truth, sensor, tracker, score, report."""
