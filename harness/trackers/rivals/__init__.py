"""Trackers of today that are written here from their papers: boxes, interacting models, and the PMBM filter."""
