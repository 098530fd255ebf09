"""The filter's settings; every number that is not the sensor's or the motion model's.

The groups of ``FilterOptions`` itself hold for both update rules, those of ``joint`` and ``max_likelihood`` for one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from mmpf.settings import NotNegative, Positive, Probability, Settings, in_unit

UpdateName = Literal["joint", "max_likelihood"]
Reading = Literal["literal", "charitable"]


class Footprint(Settings):
    """The rectangle that stands for a vehicle whose size is not measured: the mean and spread on US-101."""

    length_m: Positive = 4.7
    """Mean length."""
    width_m: Positive = 1.9
    """Mean width."""
    std_length_m: Positive = 2.0
    """Spread of lengths, wide enough for trucks; measured lengths narrow it down."""
    std_width_m: Positive = 0.3
    """Spread of widths."""


MEAN_CAR = Footprint()
OTHER_SPEED_ERROR = 0.4


class ModelErrorOptions(Settings):
    """Noise that the filter adds to every motion model's prediction, since no model is the truth.

    Root spectral densities of white noise: a standard deviation over one second grows with the root of time.
    """

    speed: Annotated[NotNegative | None, in_unit("m/s/√s")] = None
    """Noise on the longitudinal speed. None for what was better on the tuning seeds: nothing for a model that spreads
    the speed itself, as the learned driver does (``mmpf.motion.protocol.spreads_speed``), under the joint rule, whose
    smoothing keeps its particles apart, and 0.4 otherwise.
    """
    accel: Annotated[NotNegative, in_unit("m/s²/√s")] = 0.6
    """Noise on the longitudinal acceleration."""
    lat_speed: Annotated[NotNegative, in_unit("m/s/√s")] = 0.2
    """Noise on the lateral speed."""
    hidden_lon_factor: NotNegative = 1.3
    """Factor on the longitudinal ones for components that are not seen: there the model alone says where they are."""


class BirthOptions(Settings):
    """How the particles of a new component are drawn around its detection."""

    local_speed_share: Probability = 0.6
    """Share of particles whose speed is drawn near the speed of the traffic around."""
    local_speed_std_mps: Positive = 2.5
    """Spread of their speeds."""
    other_speed_std_mps: Positive = 8.0
    """Spread of the other particles' speeds: the neighbours alone would lose the fast lane."""
    lat_speed_std_mps: Positive = 0.4
    """Spread of the lateral speed."""
    accel_std_mps2: Positive = 0.7
    """Spread of the longitudinal acceleration."""
    local_range_m: Positive = 40.0
    """Tracks within this distance tell the speed of the traffic around."""
    first_existence: Probability = 0.5
    """Existence probability of the components of the first scan, of which nothing is known beforehand."""


class FlowOptions(Settings):
    """The speed of the traffic that a vehicle swims in, for motion models that ask for it."""

    length_m: Positive = 25.0
    """The weight of a seen vehicle's speed falls by e over this distance."""
    other_lane_weight: Probability = 0.15
    """Weight of vehicles in other lanes against those in the own lane."""


class ReportingOptions(Settings):
    """When a component counts as hidden and which hidden ones are reported."""

    hidden_after_s: Positive = 0.25
    """Unseen for longer, a component counts as hidden: it is reported as hidden, its particles move as those of a
    hidden vehicle, and its speed tells newborn components nothing of the traffic.
    """
    reported_std_lon_m: Positive = 15.0
    """A hidden component spread wider than this is kept in memory, for re-acquisition, but not reported: nobody could
    use it.
    """


class JointDetectability(Settings):
    """How probably a vehicle is detected where it is, and what "not seen" is worth."""

    shadow: bool = True
    """Whether the detection probability depends on shadows; without, it is ``fixed_probability``."""
    fixed_probability: Probability = 0.5
    """Detection probability everywhere if shadows do not count."""
    occluder_existence: Probability = 0.2
    """Components above this existence probability cast shadows."""
    hidden_probability: Probability = 0.02
    """Detection probability of a particle that lies in shadow."""
    run_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.12
    """Share of time that vehicles are expected to spend in runs of misses that no shadow explains."""
    run_s: Positive = 0.8
    """Mean length of such a run."""


class JointAssociation(Settings):
    """Which detection may belong to which component, and which to a new one."""

    gate_std: Positive = 4.5
    """A detection counts for a component within this many standard deviations."""
    exclusive: bool = True
    """Whether a detection belongs to one component (belief propagation) or may serve several (PDA)."""
    hit_probability: Probability = 0.5
    """A component counts as seen if it has a detection with more than this probability."""
    clutter_memory_s: Positive | None = 10.0
    """False detections are counted over about so long, beginning with the data sheet's number; None for that number."""
    birth_density: Annotated[Positive, in_unit("births per false detection")] = 0.3
    """Expected newborn vehicles in relation to clutter at one detection (b in Meyer et al. 2018)."""
    birth_unexplained: Probability = 0.3
    """A detection starts a component if its unexplained share is above this."""
    exclusion_per_s: NotNegative = 9.0
    """How strongly a hidden particle inside a seen track's footprint is discounted."""


class JointExistence(Settings):
    """Whether a component is a vehicle, and when it is believed."""

    death_rate_per_s: NotNegative = -10.0 * math.log(0.999)
    """Rate at which vehicles cease to be there; by default one in a thousand does each tenth of a second."""
    largest: Probability = 0.99
    """No component is more certain than this."""
    confirm_above: Probability = 0.6
    """Existence probability above which a component is reported."""
    confirm_hits: Annotated[int, Field(ge=1)] = 3
    """Detections that a component must have had before it is reported."""
    same_place_share: NotNegative = 0.75
    """Nearer than this share of a length and a width to a confirmed component whose place is known, none is
    confirmed.
    """
    known_place_std_lon_m: NotNegative = 1.0
    """A component that is spread less than this has a known place."""


class JointGhosts(Settings):
    """Whether a source of detections is a vehicle or a false object that stays for a while."""

    weighed: bool = True
    """Whether the question is asked; without, everything that exists is a vehicle."""
    vehicle_in_view: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.05
    """Probability that what appears in plain view is a vehicle."""
    vehicle_out_of_view: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.8
    """Probability that what appears at a shadow's or the range's edge, or in the first scan, is a vehicle."""
    edge_m: Positive = 8.0
    """Width of the range's edge."""
    seen_probability: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.6
    """Probability that a false object in plain view is detected in a scan."""
    gap_credit: Probability = 0.5
    """Share of the log odds of a false object's misses that a vehicle gets back when it is seen again."""
    largest_gap_scans: NotNegative = 6.0
    """So many of its misses count at most."""
    life_s: Positive = 3.0
    """Mean life of a false object."""
    standing_share: Probability = 0.7
    """Share of false objects that stand still; the others move as traffic does."""
    standing_std_mps: Positive = 1.0
    """Spread of their speeds."""
    flow_std_mps: Positive = 4.0
    """Spread of vehicles' speeds around the traffic's."""
    shadow_doubt: Probability = 0.5
    """By this share a vehicle's detection probability is drawn towards that of plain view, since neither the shadows
    nor what they do to the sensor are exactly known.
    """
    overlap_share: NotNegative = 0.6
    """Two sources nearer than this share of a length and a width can't both be vehicles."""
    overlap_per_s: NotNegative = 3.0
    """Log odds that the lesser one of them loses a second."""
    confirm_log_odds: float = 0.5
    """Log odds of a vehicle above which a component may be reported."""
    withdraw_log_odds: float = -1.5
    """Log odds below which it is no longer reported."""


class JointNoise(Settings):
    """How the noise of detections is learned from the innovations."""

    learned: bool = True
    """Whether it is; without, detections are believed as they report themselves."""
    memory_s: Positive = 2.0
    """Innovations count for about so long."""
    followed_drift: Probability = 0.7
    """Share of the drifting noise that the filter takes for motion."""


class JointRemoval(Settings):
    """When a component is let go."""

    existence_below: Probability = 0.02
    """A component below this existence probability is removed."""
    longest_unseen_s: Positive = 10.0
    """A confirmed component unseen for longer is removed."""
    unconfirmed_unseen_s: Positive = 1.0
    """One that was never confirmed is removed when unseen for longer."""
    largest_std_lon_m: Positive = 20.0
    """A component spread wider than this is removed."""
    range_margin_m: NotNegative = 4.0
    """A component further than this beyond the sensor's range is removed."""


class JointResampling(Settings):
    """When the particles of a component are drawn anew, and how far they are smoothed."""

    effective_share: Probability = 0.3
    """A component is resampled when its effective sample size falls below this share of its particles."""
    kernel_width: Probability = 0.4
    """Resampled particles are smoothed by a kernel as wide as this share of the component's spread (Liu and West
    2001), so that little process noise does not impoverish the cloud.
    """
    young_hits: Annotated[int, Field(ge=0)] = 20
    """Up to this many hits a component is resampled from its weighted Gaussian, since its speed is still uncertain."""
    young_effective_share: Probability = 0.9
    """Takes the place of ``effective_share`` for a component of so few hits."""


class JointMerging(Settings):
    """When two components are one vehicle."""

    lon_m: Positive = 2.5
    """Components overlap if their means are nearer than this along the road and ``lat_m`` across it."""
    lat_m: Positive = 1.4
    """See ``lon_m``."""
    existence_above: Probability = 0.3
    """Components that exist with less probability do not merge: one stray detection must not take a track's place."""
    speed_mps: Positive = 4.0
    """Those whose speeds differ by more pass each other."""
    scans: Annotated[int, Field(ge=1)] = 3
    """Components that overlap for so many scans in a row become one."""


class JointIdentity(Settings):
    """When a newly confirmed component is a hidden one, seen again, and takes its identity."""

    stitch: bool = True
    """Whether identities are handed over at all."""
    unknown_density: Annotated[Positive, in_unit("1/(m² m/s)")] = 3e-5
    """Density of vehicles that were never seen before: the hidden component must make the new one's place and speed
    more probable than that.
    """
    kernel_lon_m: Positive = 2.0
    """Width of the kernel around each of the hidden component's particles, longitudinal."""
    kernel_lat_m: Positive = 0.7
    """Width of that kernel, lateral."""
    kernel_speed_mps: Positive = 2.0
    """Width of that kernel, in speed."""
    both_seen_s: NotNegative = 0.5
    """For this long the hidden one may have been seen after the new one's birth."""


class JointOptions(Settings):
    """Soft joint association: marginals by belief propagation, existence, births by unexplained detections."""

    detectability: JointDetectability = JointDetectability()
    """How probably a vehicle is detected where it is."""
    association: JointAssociation = JointAssociation()
    """Which detection may belong to which component."""
    existence: JointExistence = JointExistence()
    """Whether a component is a vehicle."""
    ghosts: JointGhosts = JointGhosts()
    """Whether it is a vehicle or a false object."""
    noise: JointNoise = JointNoise()
    """How noisy detections are."""
    removal: JointRemoval = JointRemoval()
    """When a component is let go."""
    resampling: JointResampling = JointResampling()
    """When particles are drawn anew."""
    merging: JointMerging = JointMerging()
    """When two components are one vehicle."""
    identity: JointIdentity = JointIdentity()
    """When a new component is a hidden one, seen again."""


class PaperAssociation(Settings):
    """Which components take part in the measurement update, and count as seen."""

    gate_std: Positive = float("inf")
    """A component with no detection within this many standard deviations performs no measurement update. Infinite in
    the paper: the largest likelihood counts however small it is.
    """
    hit_gate_std: Positive = 4.5
    """A component that performs an update counts as seen if a detection is within this many standard deviations."""
    shadowed_share: Probability = 0.85
    """Share of its extent in shadow from which a component counts as completely occluded."""


class PaperExistence(Settings):
    """When a component starts, what it weighs at least, and when it is believed."""

    added_particles: Probability = 0.1
    """a of the paper, as a share of one component's particles: a detection that fewer particles chose starts a
    component.
    """
    floor_weight: Probability = 0.0
    """Keeps component weights from falling below this share of the mean; zero is the paper's equation (11), whose
    product over time starves components.
    """
    weights_anew: bool = False
    """Whether every scan begins with components that weigh alike, so that equation (11) speaks of that scan alone."""
    confirm_hits: Annotated[int, Field(ge=1)] = 3
    """Scans with an update before a component is reported."""


class PaperRemoval(Settings):
    """When a component is let go."""

    weight: Probability = 0.0
    """r of the paper: a component whose weight falls below this share of the mean component weight is removed."""
    longest_unseen_s: Positive = 10.0
    """A component unseen for longer is removed."""
    unconfirmed_unseen_s: Positive = 10.0
    """One that was never confirmed is removed when unseen for longer."""
    range_margin_m: NotNegative = 4.0
    """A component further than this beyond the sensor's range has left the observation area and is removed."""


class PaperResampling(Settings):
    """When the particles of a component are drawn anew."""

    effective_share: Probability = 0.5
    """A component is resampled when its effective sample size falls below this share of its particles."""


class PaperMerging(Settings):
    """When two components overlap significantly and become one."""

    lon_m: Positive = 2.5
    """Components overlap if their means are nearer than this along the road and ``lat_m`` across it."""
    lat_m: Positive = 1.0
    """See ``lon_m``."""
    keep_seen: bool = False
    """Whether the name that stays is that of the confirmed one, among equals of the one in sight, and only then the
    elder's.
    """


class PaperReclustering(Settings):
    """Which components' particles are dealt out anew by k-medoids."""

    lon_m: Positive = 7.0
    """Components touch if their means are nearer than this along the road and ``lat_m`` across it."""
    lat_m: Positive = 2.5
    """See ``lon_m``."""
    voters: Annotated[int, Field(ge=10)] = 200
    """Particles of a group that vote on the medoids; the rest follow the nearest one."""
    alike: bool = False
    """Whether each particle's vote counts alike, whatever it and its component weigh."""


CHARITABLE: dict[str, dict[str, Any]] = {
    "association": {"gate_std": 3.0},
    "existence": {"weights_anew": True},
    "removal": {"unconfirmed_unseen_s": 1.0},
    "merging": {"keep_seen": True},
    "reclustering": {"lon_m": 3.0, "lat_m": 1.2, "alike": True},
}


class MaxLikelihoodOptions(Settings):
    """The paper's own rule: each particle's likelihood is its largest over all detections."""

    reading: Reading = "literal"
    """How the paper's text is read where it leaves a choice: as it stands, or as kindly to its rule as it allows.
    ``charitable`` gives other defaults to ``association.gate_std`` (3), ``existence.weights_anew`` (true),
    ``removal.unconfirmed_unseen_s`` (1), ``merging.keep_seen`` (true) and ``reclustering.lon_m``, ``lat_m`` and
    ``alike`` (3, 1.2, true); what is set by hand stays.
    """
    association: PaperAssociation = PaperAssociation()
    """Which components take part in the measurement update."""
    existence: PaperExistence = PaperExistence()
    """When a component starts and is believed."""
    removal: PaperRemoval = PaperRemoval()
    """When a component is let go."""
    resampling: PaperResampling = PaperResampling()
    """When particles are drawn anew."""
    merging: PaperMerging = PaperMerging()
    """When two components become one."""
    reclustering: PaperReclustering = PaperReclustering()
    """Which components' particles are dealt out anew."""

    @model_validator(mode="before")
    @classmethod
    def _read_charitably(cls, values: Any) -> Any:  # noqa: ANN401
        if not isinstance(values, Mapping) or values.get("reading") != "charitable":
            return values
        kindly = dict(values)
        for group, defaults in CHARITABLE.items():
            given = values.get(group, {})
            if isinstance(given, Mapping):
                kindly[group] = {**defaults, **given}
        return kindly


class FilterOptions(Settings):
    """All settings of the Modified Mixture Particle Filter."""

    particles: Annotated[int, Field(ge=10, le=1_000_000)] = 1000
    """Particles per component."""
    update: UpdateName = "joint"
    """Update rule: ``joint``, or ``max_likelihood`` for the rule of the paper."""
    vehicle: Footprint = Footprint()
    """Size of a vehicle before it is measured."""
    model_error: ModelErrorOptions = ModelErrorOptions()
    """Noise added to the motion model's prediction."""
    birth: BirthOptions = BirthOptions()
    """How new components are drawn."""
    flow: FlowOptions = FlowOptions()
    """The speed of the traffic around a vehicle."""
    reporting: ReportingOptions = ReportingOptions()
    """When a component counts as hidden and which hidden ones are reported."""
    joint: JointOptions = JointOptions()
    """Settings that only the joint update reads."""
    max_likelihood: MaxLikelihoodOptions = MaxLikelihoodOptions()
    """Settings that only the paper's update reads."""


def speed_error(options: FilterOptions, *, spreads_speed: bool) -> float:
    """Return the noise on the speed that the filter adds to a motion model's prediction.

    Args:
        options: The filter's settings.
        spreads_speed: Whether the model spreads the speed by itself; see ``mmpf.motion.protocol.spreads_speed``.

    Returns:
        Root spectral density, m/s per root second; see ``ModelErrorOptions.speed``.
    """
    if options.model_error.speed is not None:
        return options.model_error.speed
    return 0.0 if spreads_speed and options.update == "joint" else OTHER_SPEED_ERROR
