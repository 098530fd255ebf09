"""Recorded and simulated driving that studies and training share."""
