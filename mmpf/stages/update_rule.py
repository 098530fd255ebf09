"""The role of an update rule: the stages of the paper's Fig. 1 between the prior update and the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mmpf.belief.birth import Traffic
from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.protocol import MotionModel
from mmpf.numerics.arrays import BoolArray, FloatArray
from mmpf.scan import Scan, SensorModel
from mmpf.visibility.false_objects import FalseObjects
from mmpf.visibility.range_profile import Reach


@dataclass(frozen=True)
class Situation:
    """What the stages of one scan share.

    Attributes:
        scan: The scan.
        sensor: The sensor's data sheet.
        motion: The motion model.
        dt_s: Time since the scan before.
        traffic: Speeds of the vehicles around, for births.
        plane: The plane in which the sensor sees.
        reach: How well the sensor sees at each distance.
        false_objects: What false objects are like.
    """

    scan: Scan
    sensor: SensorModel
    motion: MotionModel
    dt_s: float
    traffic: Traffic
    plane: SensorPlane
    reach: Reach
    false_objects: FalseObjects = field(default_factory=FalseObjects.none)


@dataclass(frozen=True)
class Occlusion:
    """What is known, before looking at the detections, of whether components can be seen.

    Attributes:
        detection_probability: Of each particle, shape (n,).
        run_probability: Of each component, that the sensor is in a run of misses of it, shape (m,); it is part of the
            detection probability.
    """

    detection_probability: FloatArray
    run_probability: FloatArray


@dataclass(frozen=True)
class Updated:
    """The belief after the measurement update, and what the later stages need to know of it.

    Attributes:
        mixture: The belief.
        was_hit: Components that the scan confirmed, shape (m,).
        birth_claim: How strongly each detection asks for a new component, 0 to 1, shape (d,).
        association_entropy: Mean entropy of the components' association, nats; 0 where each detection is clearly
            one component's.
        effective_share: Mean effective sample size after weighting, as a share of the particles.
        false_detections: Expected number of detections of the scan that no vehicle gave; None if the rule does not say.
        reach: How well the sensor sees at each distance, after the scan; None if the rule does not say.
    """

    mixture: Mixture
    was_hit: BoolArray
    birth_claim: FloatArray
    association_entropy: float
    effective_share: float
    false_detections: float | None = None
    reach: Reach | None = None


@dataclass(frozen=True)
class MixtureChange:
    """The belief after a stage that changes the number of components.

    Attributes:
        mixture: The belief.
        removed: Components removed.
        added: Components added.
        merged: Components merged into others.
        false_objects: What false objects are like, after those removed; None if the rule does not say.
    """

    mixture: Mixture
    removed: int = 0
    added: int = 0
    merged: int = 0
    false_objects: FalseObjects | None = None


class UpdateRule(Protocol):
    """The stages of one rule, in the order in which the filter calls them; ``moments`` are those of ``prior``."""

    def assert_occlusion(self, prior: Mixture, moments: Moments, situation: Situation) -> Occlusion:
        """Say which components can't be seen: "Complete occlusion assertion"."""
        ...

    def measurement_update(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Updated:
        """Weigh the particles by the detections and resample: "Measurement update", equations (5) to (11)."""
        ...

    def remove_add_merge(self, updated: Updated, situation: Situation, rng: np.random.Generator) -> MixtureChange:
        """Adapt the number of components: "Remove & Add & Merge"."""
        ...

    def finetune(self, mixture: Mixture, situation: Situation, rng: np.random.Generator) -> tuple[Mixture, int]:
        """Settle which particle and which identity belongs to which component: "Finetune".

        Returns:
            The belief, and how many components were clustered anew or had their identity settled.
        """
        ...

    def weight_update(self, mixture: Mixture) -> Mixture:
        """Compute particle and component weights anew: "Weight update"."""
        ...


def outside_observation_area(lon_m: FloatArray, lat_m: FloatArray, situation: Situation, margin_m: float) -> BoolArray:
    """Return which positions lie beyond the sensor's range and the margin, shape (m,)."""
    return np.asarray(situation.plane.distance_m(lon_m, lat_m) > situation.sensor.range_m + margin_m)
