"""Rows of the state of a particle or a track."""

from __future__ import annotations

LON, LAT, SPEED, LAT_SPEED, ACCEL, LAT_ACCEL = range(6)
STATE_SIZE = 6
