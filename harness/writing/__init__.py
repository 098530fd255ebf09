"""Markdown, figures, numbers and progress; knows nothing of traffic or tracking."""
