"""What every package stands on: errors, exit codes, files, progress and statistics; nothing of traffic or tracking."""
