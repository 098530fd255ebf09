"""Shared by all packages: errors, exit codes, files, progress and statistics; nothing of traffic or tracking."""
