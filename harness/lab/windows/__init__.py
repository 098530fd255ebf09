"""Recorded and made driving that studies and training share."""
