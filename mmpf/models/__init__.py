"""Fitted models and process noise, committed as data, and their cards."""
