"""Who and what is around each particle: neighbours, adjacent lanes, stop lines and right of way."""
