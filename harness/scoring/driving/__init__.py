"""What the driver would do by the truth and by the tracks."""
