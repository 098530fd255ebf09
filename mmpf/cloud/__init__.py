"""Particles and components: moments, resampling, birth, sizes."""
