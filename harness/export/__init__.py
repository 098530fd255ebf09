"""Writes a run in other programs' formats."""
