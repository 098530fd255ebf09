"""What the sensor can see: shadows, range, detection probability and false detections."""
