"""What the ego vehicle's sensor can see past the other vehicles."""
