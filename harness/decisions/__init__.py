"""Driver models: they take what the ego believes about vehicles around it and return commands.

Nothing here knows of truth or trackers: both are bodies on the road, and the same driver is asked with either.
"""
