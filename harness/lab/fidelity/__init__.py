"""How realistic the simulated traffic is, and the calibration of its drivers and demands to measurements."""
