"""The intensity of vehicles that were never detected."""
