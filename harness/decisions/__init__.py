"""What a driver would do with what it believes of the vehicles around it: beliefs in, commands out.

Nothing here knows of truth or trackers: both are bodies on the road, and the same driver is asked with either.
"""
