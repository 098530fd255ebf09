"""The update-rule protocol: the stages of the paper's Fig. 1 between prior update and report."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mmpf.belief.birth import Traffic
from mmpf.belief.mixture import Components, Mixture
from mmpf.belief.moments import Moments
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.protocol import MotionModel
from mmpf.numerics.arrays import BoolArray, FloatArray
from mmpf.options.filter import ModelErrorOptions
from mmpf.scan import Scan, SensorModel
from mmpf.visibility.range_profile import Reach

RANGE_MARGIN_M = 4.0
"""Tracks end that are farther than this beyond the sensor's range."""


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
    """

    scan: Scan
    sensor: SensorModel
    motion: MotionModel
    dt_s: float
    traffic: Traffic
    plane: SensorPlane


@dataclass(frozen=True)
class Occlusion:
    """The visibility of components, known before looking at the detections.

    Attributes:
        detection_probability: Of each particle, shape (n,).
        run_probability: Of each component, that the sensor is in a run of misses of it, shape (m,); it is part of the
            detection probability.
        lasting_probability: The same if runs that have lasted last on; particles are weighed by it.
    """

    detection_probability: FloatArray
    run_probability: FloatArray
    lasting_probability: FloatArray


@dataclass(frozen=True)
class Updated:
    """The belief after the measurement update, with what later stages need of it.

    Attributes:
        birth_claim: How strongly each detection asks for a new component, 0 to 1, shape (d,).
        association_entropy: Mean entropy of the components' association, nats; 0 where each detection is clearly one
            component's.
        effective_share: Mean effective sample size after weighting, as a share of the particles.
        false_detections: Expected number of detections of the scan that no vehicle gave; None if the rule does not say.
        reach: How well the sensor sees at each distance, after the scan; None if the rule does not say.
        weight: The particles' weights, shape (n,); None if the rule does not say.
    """

    mixture: Mixture
    birth_claim: FloatArray
    association_entropy: float
    effective_share: float
    false_detections: float | None = None
    reach: Reach | None = None
    weight: FloatArray | None = None


@dataclass(frozen=True)
class MixtureChange:
    """The belief after a stage that changes the number of components.

    Attributes:
        mixture: The belief.
        moments: Its components' moments.
        removed: Components removed.
        added: Components added.
        merged: Components merged into others.
    """

    mixture: Mixture
    moments: Moments
    removed: int = 0
    added: int = 0
    merged: int = 0


@dataclass(frozen=True)
class Finetuned:
    """The belief after the last stage that may move particles from one component to another.

    Attributes:
        mixture: The belief.
        settled: Components that were clustered anew or had their identity settled.
        moments: Its components' moments; None if particles or weights are others, or will be
            after the weight update.
    """

    mixture: Mixture
    settled: int = 0
    moments: Moments | None = None


class UpdateRule(Protocol):
    """One rule with its settings and what it has learned so far; its stages come in the order of the paper's Fig. 1.

    ``moments`` are always those of the belief that comes with them.
    """

    @property
    def reach(self) -> Reach:
        """How well the sensor sees at each distance, as far as the rule learns it."""

    def motion(self, model: MotionModel) -> MotionModel:
        """Return how particles move: the model, and what the rule adds to it."""

    def model_error(self, model: MotionModel) -> ModelErrorOptions:
        """Return the noise that is added to the model's prediction, with a number for the speed."""

    def prepare(self, scan: Scan) -> Scan:
        """Return the scan as the rule uses it."""

    def first(self, count: int) -> Components:
        """Return the components of the first scan, without prior knowledge: "Initialization"."""

    def assert_occlusion(self, prior: Mixture, moments: Moments, situation: Situation) -> Occlusion:
        """Compute which components cannot be seen: "Complete occlusion assertion"."""

    def measurement_update(
        self,
        prior: Mixture,
        moments: Moments,
        occlusion: Occlusion,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Updated:
        """Weigh the particles by the detections and resample: "Measurement update", equations (5) to (11)."""

    def remove_add_merge(self, updated: Updated, situation: Situation, rng: np.random.Generator) -> MixtureChange:
        """Adapt the number of components: "Remove & Add & Merge"."""

    def finetune(self, mixture: Mixture, moments: Moments, situation: Situation, rng: np.random.Generator) -> Finetuned:
        """Decide which particle and which identity belongs to which component: "Finetune"."""

    def weight_update(self, mixture: Mixture) -> Mixture:
        """Recompute particle and component weights: "Weight update"."""


def outside_observation_area(lon_m: FloatArray, lat_m: FloatArray, situation: Situation) -> BoolArray:
    """Return which positions lie more than ``RANGE_MARGIN_M`` beyond the sensor's range, shape (m,)."""
    return np.asarray(situation.plane.distance_m(lon_m, lat_m) > situation.sensor.range_m + RANGE_MARGIN_M)
