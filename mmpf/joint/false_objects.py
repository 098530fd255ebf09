"""Learned properties of sources: detection probability, and the rates of false objects.

No data sheet tells. A component that ends in plain view was a false object with a probability that its own posterior
says; such components are counted, and slowly forgotten, and so are vehicles with their detectability. The counts begin
at a few imaginary objects of a prior that knows no sensor; the number of false ones alone follows from the data sheet.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from mmpf.joint.kinds import FALSE, KINDS, LEVELS, SHADING, VEHICLE, shares_of
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.options.joint import JointFalseObjects, JointVehicles
from mmpf.scan import SensorModel

FALSE_KINDS = KINDS - 1
# A vehicle that was hardly looked at says nothing of its detectability.
FEWEST_HITS = 10
PRIOR_APPEAR_S = 3.0
"""Weight of the prior rate of vehicles that are first detected in plain view, in seconds."""


@dataclass(frozen=True)
class FalseObjects:
    """Expected counts of false objects and of vehicles so far.

    The first axis of what is counted of false objects tells those that stand from those that move.

    Attributes:
        counted: Expected number of false objects by level of detectability, shape (2, levels).
        ended: Expected number of false objects that ended, shape (2,).
        lived_s: Their expected time alive, shape (2,).
        vehicles: Expected number of vehicles that are gone, by how much shadows hide them and by level, shape
            (3, levels).
        present: The same of those that are there, shape (3, levels).
        in_view: Expected number of vehicles that appeared in plain view, gone and present, shape (2,).
        stood: Expected number of vehicles that never moved, gone and present, shape (2,).
        watched_s: Time over which they were counted, forgotten like them.
        since_start_s: Time since the first scan.
    """

    counted: FloatArray
    ended: FloatArray
    lived_s: FloatArray
    vehicles: FloatArray
    present: FloatArray
    in_view: FloatArray
    stood: FloatArray
    watched_s: float = 0.0
    since_start_s: float = 0.0

    @classmethod
    def none(cls) -> Self:
        """Return the counts before the first scan."""
        return cls(
            np.zeros((FALSE_KINDS, LEVELS)),
            np.zeros(FALSE_KINDS),
            np.zeros(FALSE_KINDS),
            np.zeros((len(SHADING), LEVELS)),
            np.zeros((len(SHADING), LEVELS)),
            np.zeros(2),
            np.zeros(2),
        )

    def after(self, dt_s: float, memory_s: float) -> Self:
        """Return the counts a step later."""
        kept = np.exp(-dt_s / memory_s)
        return replace(
            self,
            counted=kept * self.counted,
            ended=kept * self.ended,
            lived_s=kept * self.lived_s,
            vehicles=kept * self.vehicles,
            in_view=kept * self.in_view,
            stood=kept * self.stood,
            watched_s=kept * self.watched_s + dt_s,
            since_start_s=self.since_start_s + dt_s,
        )

    def with_removed(self, kinds: FloatArray, ended: FloatArray, lived_s: FloatArray) -> Self:
        """Return the counts with components that are removed.

        Args:
            kinds: Their probabilities of each case, that there is still a source included, shape (k, *SHAPE).
            ended: Probability that each was a false object that has ended, by level, shape (k, 2, levels).
            lived_s: Time from birth to last detection of each, shape (k,).
        """
        still = kinds[:, FALSE].sum(axis=2)
        were = (ended + still).sum(axis=2)
        return replace(
            self,
            counted=self.counted + (ended + still).sum(axis=0),
            ended=self.ended + ended.sum(axis=(0, 2)),
            lived_s=self.lived_s + (were.T * lived_s).sum(axis=1),
        )

    def with_vehicles(
        self,
        kinds: FloatArray,
        hits: IntArray,
        born_in_view: FloatArray,
        stood: FloatArray,
        removed: BoolArray,
    ) -> Self:
        """Return the counts with the vehicles that are present and those that leave.

        Args:
            kinds: Probabilities of each case of all components, that there is a source included, shape (m, *SHAPE).
            hits: Their detections, shape (m,).
            born_in_view: Degree, 0 to 1, to which each appeared in plain view, shape (m,).
            stood: Degree, 0 to 1, to which each never moved, shape (m,).
            removed: Which of them are removed, shape (m,).
        """
        profiles = kinds[:, VEHICLE] * (hits >= FEWEST_HITS)[:, None, None]
        number = profiles.sum(axis=(1, 2))

        def counted(before: FloatArray, degree: FloatArray) -> FloatArray:
            each = number * degree
            return np.array([before[0] + each[removed].sum(), each[~removed].sum()])

        return replace(
            self,
            vehicles=self.vehicles + profiles[removed].sum(axis=0),
            present=profiles[~removed].sum(axis=0),
            in_view=counted(self.in_view, born_in_view),
            stood=counted(self.stood, stood),
        )

    def vehicle_profile(self, options: JointVehicles) -> FloatArray:
        """Return the share of vehicles at each level of detectability, shape (levels,)."""
        prior = options.prior_count * shares_of(options.detectability)
        return shares_of((self.vehicles + self.present).sum(axis=0) + prior)

    def vehicle_shading(self, options: JointVehicles) -> FloatArray:
        """Return the distribution of how much shadows hide vehicles, shape (3,)."""
        prior = options.prior_count * shares_of(options.shading)
        return shares_of((self.vehicles + self.present).sum(axis=1) + prior)

    def vehicles_in_view_per_s(self, usual: float) -> float:
        """Return how many vehicles a second are first detected in plain view; ``usual`` is the prior rate.

        What was counted can only raise the rate: that none was found so far rules out no car that nobody has seen.
        """
        known = PRIOR_APPEAR_S * usual + float(self.in_view.sum())
        return max(known / (PRIOR_APPEAR_S + self.watched_s), usual)

    def standing_share(self, usual: FloatArray | float, options: JointVehicles) -> FloatArray | float:
        """Return the share of vehicles that stand, in the shape of ``usual``, the prior; counts can only raise it."""
        known = float((self.vehicles + self.present).sum())
        standing = options.prior_count * usual + float(self.stood.sum())
        return np.maximum(standing / (options.prior_count + known), usual)

    def births_per_s(self, sensor: SensorModel, options: JointFalseObjects) -> float:
        """Return how many appear each second in the sensor's range."""
        first = options.birth_share * sensor.clutter_per_scan
        appeared = options.prior_watched_s * first + float(self.counted.sum())
        return appeared / (options.prior_watched_s + self.watched_s)

    def kind_shares(self, options: JointFalseObjects) -> FloatArray:
        """Return the share of new ones that stand and that move, shape (2,)."""
        prior = options.prior_count * np.array([options.standing_share, 1.0 - options.standing_share])
        return shares_of(self.counted.sum(axis=1) + prior)

    def profiles(self, options: JointFalseObjects) -> FloatArray:
        """Return the share of each level of detectability among those that stand and that move, shape (2, levels).

        What was learned of one kind is where the other begins: one sensor makes both.
        """
        together = self.counted.sum(axis=0) + options.prior_count * shares_of(options.detectability)
        number = self.counted + options.prior_count * together / together.sum()
        return np.asarray(number / number.sum(axis=1, keepdims=True))

    def mean_life_s(self, options: JointFalseObjects) -> FloatArray:
        """Return the mean life of those that stand and of those that move, shape (2,)."""
        prior = options.prior_count
        return np.asarray((self.lived_s + prior * options.life_s) / (self.ended + prior))
