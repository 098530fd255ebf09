"""Trackers behind one protocol: the project's own and other projects', on the same detections."""
