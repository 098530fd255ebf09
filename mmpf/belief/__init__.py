"""What the filter believes: particles, components, their moments, births and resampling."""
