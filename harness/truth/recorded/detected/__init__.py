"""Recordings that bring a real detector's boxes beside labels that go on where the detector is blind."""
