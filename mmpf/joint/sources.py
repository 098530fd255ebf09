"""The joint rule's state for each component: any source of detections, which may be a vehicle."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from mmpf.belief.mixture import NEVER, Components, Mixture
from mmpf.joint.kinds import KINDS, LEVELS, certain_vehicles, vehicle_share
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.options.filter import MEAN_CAR, Footprint

AT_FIRST_ZERO: tuple[str, ...] = ("detected_s", "missed", "unexplained", "stood_log", "born_in_view")
AT_FIRST_ZERO += ("score_log", "noise_lon_m", "noise_lat_m", "overlap_s", "mistaken")


@dataclass(frozen=True)
class Sources(Components):
    """The components of the joint rule, struct of arrays over m of them; ``existence`` is that of any source.

    Attributes:
        withdrawn: Whether it was reported as a track, until it was taken for a false object.
        detected_s: For how long it was detected after its birth: each hit counts for the time since the scan before.
        missed: Probability that the sensor is in a run of misses of this vehicle.
        unexplained: The same if runs that have lasted last on, for the weights of particles; see ``LASTS_ON``.
        kinds: Probability of each kind of source with its detectability, given that there is one, shape (m, 3, 3,
            levels); see ``mmpf.joint.kinds``.
        ended: Probability that it was a false object that has ended, by kind and level, shape (m, 2, levels).
        speed_log: Log likelihood of its speed by kind, as it went into ``kinds``, shape (m, 3).
        standing_ratio: How much oftener a vehicle that stands appears where it did than one that moves.
        stood_log: Log likelihood, at most 0, that it stood at its fastest moment whose speed was well known.
        born_in_view: Degree, 0 to 1, to which it appeared in plain view.
        score_log: Mean log odds of the scores of its detections after the first; 0 without scores.
        noise_factor: Measured noise over reported noise, from the innovations.
        noise_lon_m: Longitudinal deviation of its detections, smoothed, as reported and times that factor.
        noise_lat_m: The same, lateral.
        overlap_with: ``track_id`` of the component that it has been overlapping, ``NEVER`` if none.
        overlap_s: For how long, scan after scan.
        mistaken: Probability that what it follows is not the vehicle that was hidden; see ``mmpf.joint.mistaken``.
        away_std: How far the vehicle is then, root mean square along the frame's axes and in speed, shape (m, 3).
    """

    withdrawn: BoolArray
    detected_s: FloatArray
    missed: FloatArray
    unexplained: FloatArray
    kinds: FloatArray
    ended: FloatArray
    speed_log: FloatArray
    standing_ratio: FloatArray
    stood_log: FloatArray
    born_in_view: FloatArray
    score_log: FloatArray
    noise_factor: FloatArray
    noise_lon_m: FloatArray
    noise_lat_m: FloatArray
    overlap_with: IntArray
    overlap_s: FloatArray
    mistaken: FloatArray
    away_std: FloatArray

    @property
    def vehicle_share(self) -> FloatArray:
        """Probability that each is a vehicle, given that there is a source, shape (m,)."""
        return vehicle_share(self.kinds)

    @property
    def noise_m(self) -> tuple[FloatArray, FloatArray]:
        """Deviations of each one's detections as measured by its innovations, along and across, each of shape (m,)."""
        return self.noise_lon_m, self.noise_lat_m

    @property
    def elsewhere(self) -> tuple[FloatArray, FloatArray]:
        """Probability that each follows another source, (m,), and the vehicle's mean squared offsets then, (3, m)."""
        return self.mistaken, self.away_std.T**2

    def after_scan(self, was_hit: BoolArray, dt_s: float, log_odds: FloatArray | float = 0.0) -> Self:
        """Return the components with hits, the expected log odds of their scores, (m,), and times seen and unseen."""
        after = super().after_scan(was_hit, dt_s)
        change = was_hit * (log_odds - self.score_log) / np.maximum(after.hits - 1, 1)
        return after.having(detected_s=self.detected_s + dt_s * was_hit, score_log=self.score_log + change)

    def score_log_odds(self, correlation: float) -> FloatArray:
        """Return the log odds of a vehicle by all scores of each, shape (m,).

        The log likelihood ratio of equally correlated normal log odds of one variance, whose mean depends on the kind.
        """
        scores = self.hits - 1
        return np.asarray(self.score_log * scores / (1.0 + correlation * np.maximum(scores - 1, 0)))

    @classmethod
    def newborn(cls, track_id: IntArray, existence: FloatArray, vehicle: Footprint = MEAN_CAR) -> Self:
        """Return components of their first scan, certain vehicles; arguments are those of ``Components.newborn``."""
        count = len(track_id)
        zeros = dict.fromkeys(AT_FIRST_ZERO, np.zeros(count))
        return cls(
            **(vars(Components.newborn(track_id, existence, vehicle)) | zeros),
            withdrawn=np.zeros(count, dtype=np.bool_),
            kinds=certain_vehicles(count),
            ended=np.zeros((count, KINDS - 1, LEVELS)),
            speed_log=np.zeros((count, KINDS)),
            standing_ratio=np.ones(count),
            noise_factor=np.ones(count),
            overlap_with=np.full(count, NEVER),
            away_std=np.zeros((count, 3)),
        )


def sources_of(mixture: Mixture) -> Sources:
    """Return the components of a belief that the joint rule began.

    Raises:
        TypeError: Another rule began it.
    """
    if not isinstance(mixture.components, Sources):
        raise TypeError("the belief is not the joint rule's: its components have none of the rule's columns")
    return mixture.components
