"""What surrounds each particle: neighbours, lanes, shadows."""
