"""Compares a driver's decisions by the truth with those by the tracks."""
