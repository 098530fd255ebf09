"""The traffic and road around each particle: neighbours, adjacent lanes, stop lines and right of way."""
