"""The constants of the scoring rules."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ScoringSettings:
    """Gates, times and counts of the scoring rules; the defaults are the rules that results are published under.

    Attributes:
        in_sight_detections: Detections that a vehicle needs to count as in sight.
        in_sight_s: Longest time since the last detection of a vehicle in sight, or near a track in sight.
        memory_s: A vehicle that goes undetected for longer ends as a truth identity and returns as a new one.
        hold_s: A track holds a vehicle at its last detection if it was matched to it at most this long before.
        event_s: Shortest time without detection of an occlusion event; at most ``event_short_s`` of a short one.
        event_hidden_share: Share of that time for which the vehicle must be hidden.
        event_detections: Detections that the vehicle needs in the ``event_history_s`` before.
        event_judged_s: Time from re-detection to judgement.
        reacquire_limit_s: Longest time from re-detection to re-acquisition.
        prompt_s: A vehicle that becomes visible should have a track after this time.
        hidden_bins_s: Edges of the bins of the time since the last detection.
        follow_cutoff_m: Distance from which a track does not follow a vehicle, and what a vehicle costs that none does.
        gospa_cutoff_m: Cut-off distance c of GOSPA, whose order p is ``gospa_order``.
        bootstrap_draws: Resamples behind each interval.
        brakes_mps2: Acceleration at or below which a driver brakes; above ``rolls_mps2`` it does not.
        decision_s: Shortest time for which truth and tracks must differ for a missed or a phantom braking.
        driver_existence: Existence from which a driver takes a track for a vehicle; for one with less it brakes gently.
        driver_settled_s: Time from the beginning of an ego's stay until its driver's decisions are judged.
        collision_time_s: Time to collision below which errors of it count.
        longest_collision_time_s: Longest time to collision that is told apart from none.
        plain_view_m: Distance from the ego up to which vehicles in plain view must have a track.
        plain_view_s: Time in plain view without interruption from which they must.
        plain_view_vehicle_s: Shortest time in plain view of a vehicle that is ranked, or counts as never reported.
        worst_share: Share of the vehicles that are the worst.
        dropped_s: Shortest time in plain view without its track of a vehicle that is dropped.
        standing_mps: Speed below which a vehicle stands; it is stopped after ``standing_s`` of that.
        flowing_mps: Mean speed of the others above which it is stopped amid traffic.
        existence_track_steps: Track-steps from which a tenth of the stated existence is judged.
    """

    gate_lon_m: float = 4.0
    gate_lat_m: float = 2.0
    in_sight_detections: int = 3
    in_sight_s: float = 0.5
    memory_s: float = 10.0
    hold_s: float = 0.5
    event_s: float = 0.5
    event_short_s: float = 3.0
    event_hidden_share: float = 0.7
    event_detections: int = 10
    event_history_s: float = 3.0
    event_judged_s: float = 0.5
    reacquire_limit_s: float = 5.0
    prompt_s: float = 0.5
    hidden_bins_s: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 5.0, 10.0)
    follow_cutoff_m: float = 10.0
    gospa_cutoff_m: float = 4.0
    gospa_order: float = 1.0
    bootstrap_draws: int = 1000
    brakes_mps2: float = -2.0
    rolls_mps2: float = -1.0
    decision_s: float = 0.5
    driver_existence: float = 0.5
    driver_settled_s: float = 2.0
    collision_time_s: float = 4.0
    longest_collision_time_s: float = 10.0
    plain_view_m: float = 60.0
    plain_view_s: float = 0.5
    plain_view_vehicle_s: float = 1.0
    worst_share: float = 0.1
    dropped_s: float = 0.5
    standing_mps: float = 0.5
    standing_s: float = 2.0
    flowing_mps: float = 5.0
    existence_track_steps: int = 200

    def __post_init__(self) -> None:
        """Refuse a GOSPA cut-off beyond the distance up to which vehicles and tracks are compared."""
        if self.gospa_cutoff_m > 2.0 * min(self.gate_lon_m, self.gate_lat_m):
            raise ValueError(f"gospa_cutoff_m={self.gospa_cutoff_m} must be at most twice the smaller gate")


TIME_TOLERANCE_S = 1e-6
"""Times are multiples of a step in floating point; comparisons of times allow for their rounding."""
