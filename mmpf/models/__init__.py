"""Fitted models and process noise, committed as data, and their model cards."""
