"""Trackers behind one protocol: the project's own and those of other projects."""
