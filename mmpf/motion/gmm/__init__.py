"""Conditional Gaussian mixtures."""
