"""Recordings with a real detector's boxes and labels that continue through occlusion."""
