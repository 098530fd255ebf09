"""Scores of tracks against truth, above all for the vehicles that the sensor could not see.

Conventions of all scores: the ego is no vehicle; tentative tracks are not reported and not scored; accuracies and
shares are in percent; errors are estimate minus truth; vehicles and tracks of different episodes have nothing to do
with each other; a vehicle beyond the sensor's range is neither missed nor is the track on it false, and the same holds
at and beyond the edge of the road that the truth's source knows.
"""
