"""Recorded traffic as a truth source: one module a format, and what they share on the way from rows to frames."""
