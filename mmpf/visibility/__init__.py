"""What the sensor can see and detect: shadows, range, detection probability and false objects."""
