"""Grids of runs over density, seeds, trackers, models and any other setting."""
