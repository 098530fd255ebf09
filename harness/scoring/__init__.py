"""Scores of tracks against truth, above all for the vehicles that the sensor could not see."""
