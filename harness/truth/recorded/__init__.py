"""Recorded traffic as a truth source: one module for each format, and shared steps from rows to frames."""
