"""Vehicles that the sensor has never seen: how many of them to expect on each stretch of lane."""
