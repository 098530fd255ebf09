"""Names of the rows of a particle's or track's state."""

LON, LAT, SPEED, LAT_SPEED, ACCEL, LAT_ACCEL = range(6)
STATE_SIZE = 6
