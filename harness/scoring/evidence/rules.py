"""The numbers of the scoring rules that several modules share; what one module alone needs stands there."""

GATE_LON_M, GATE_LAT_M = 4.0, 2.0
"""A track within so far of a vehicle, along it and across it, can stand for it."""
IN_SIGHT_DETECTIONS = 3
"""Detections that a vehicle needs to count as in sight."""
IN_SIGHT_S = 0.5
"""Longest time since the last detection of a vehicle in sight, or near a track in sight."""
MEMORY_S = 10.0
"""A vehicle that goes undetected for longer ends as a truth identity and returns as a new one."""
EVENT_JUDGED_S = 0.5
"""Time from re-detection to judgement of an occlusion."""
FOLLOW_CUTOFF_M = 10.0
"""Distance from which a track does not follow a vehicle, and what a vehicle costs that none does."""
BRAKES_MPS2, ROLLS_MPS2 = -2.0, -1.0
"""A driver brakes with an acceleration at or below the first; above the second it does not."""
DECISION_S = 0.5
"""Shortest time for which truth and tracks must differ for a missed or a phantom braking."""
DRIVER_EXISTENCE = 0.5
"""Existence from which a driver takes a track for a vehicle; for one with less it brakes gently."""
COLLISION_TIME_S = 4.0
"""Time to collision below which it is short: errors of it count, and a driver ought to brake."""
PLAIN_VIEW_M, PLAIN_VIEW_S = 60.0, 0.5
"""A vehicle within this distance of the ego must have a track once it was in plain view for this time."""
TIME_TOLERANCE_S = 1e-6
"""Times are multiples of a step in floating point; comparisons of times allow for their rounding."""
