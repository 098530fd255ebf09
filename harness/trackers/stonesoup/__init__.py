"""Stone Soup's trackers behind the project's protocol."""
