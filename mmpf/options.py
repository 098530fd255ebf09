"""The filter's settings; every number that is not the sensor's or the motion model's."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

UpdateName = Literal["joint", "max_likelihood"]
Positive = Annotated[float, Field(gt=0.0)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class Settings(BaseModel):
    """Base of all settings: frozen, and a key that does not exist is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Footprint(Settings):
    """The rectangle that stands for a vehicle whose size is not measured: the mean and spread on US-101.

    Attributes:
        length_m: Length.
        width_m: Width.
        std_length_m: Spread of lengths, wide enough for trucks; measured lengths narrow it down.
        std_width_m: Spread of widths.
    """

    length_m: Positive = 4.7
    width_m: Positive = 1.9
    std_length_m: Positive = 2.0
    std_width_m: Positive = 0.3


MEAN_CAR = Footprint()
OTHER_SPEED_ERROR = 0.4


class ModelErrorOptions(Settings):
    """Noise that the filter adds to every motion model's prediction, since no model is the truth.

    Root spectral densities of white noise: a standard deviation over one second grows with the root of time.

    Attributes:
        speed: Of the longitudinal speed, m/s per root second. None for what was better on the tuning seeds: nothing for
            a model that spreads the speed itself, as the learned driver does (``mmpf.motion.protocol.spreads_speed``),
            under the joint rule, whose smoothing keeps its particles apart, and 0.4 otherwise.
        accel: Of the longitudinal acceleration, m/s² per root second.
        lat_speed: Of the lateral speed, m/s per root second.
        hidden_lon_factor: What the first two are multiplied by for components that are not seen: there the model alone
            says where they are.
    """

    speed: Annotated[float, Field(ge=0.0)] | None = None
    accel: Annotated[float, Field(ge=0.0)] = 0.6
    lat_speed: Annotated[float, Field(ge=0.0)] = 0.2
    hidden_lon_factor: Annotated[float, Field(ge=0.0)] = 2.2


class BirthOptions(Settings):
    """How the particles of a new component are drawn around its detection.

    Attributes:
        local_speed_share: Share of particles whose speed is drawn near the speed of the traffic around.
        local_speed_std_mps: Spread of that share.
        other_speed_std_mps: Spread of the other particles' speeds: the neighbours alone would lose the fast lane.
        lat_speed_std_mps: Spread of the lateral speed.
        accel_std_mps2: Spread of the longitudinal acceleration.
        local_range_m: Tracks within this distance tell the speed of the traffic around.
    """

    local_speed_share: Probability = 0.6
    local_speed_std_mps: Positive = 2.5
    other_speed_std_mps: Positive = 8.0
    lat_speed_std_mps: Positive = 0.4
    accel_std_mps2: Positive = 0.7
    local_range_m: Positive = 40.0


class ReportingOptions(Settings):
    """When a component counts as hidden and which hidden ones are reported: for both update rules.

    Attributes:
        hidden_after_s: Unseen for longer, a component counts as hidden: it is reported as hidden, its particles move as
            those of a hidden vehicle, and its speed tells newborn components nothing of the traffic.
        reported_std_lon_m: A hidden component spread wider than this is kept in memory, for re-acquisition, but not
            reported: nobody could use it.
    """

    hidden_after_s: Positive = 0.25
    reported_std_lon_m: Positive = 6.0


class JointOptions(Settings):
    """Soft joint association: marginals by belief propagation, existence, births by unexplained detections.

    Attributes:
        gate_std: A detection counts for a component within this many standard deviations.
        missed_detection_cap: The detection probability used for "not seen" is at most this, since misses of one
            vehicle are correlated in time.
        missed_from_fraction: "Not seen" counts as evidence from this visible fraction on, and
        missed_full_fraction: in full from this one on: shadows are cast by vehicles whose place and size are
            uncertain.
        hidden_detection_probability: Detection probability of a particle that lies in shadow.
        survival_probability: Per 0.1 s.
        birth_density: Expected newborn vehicles in relation to clutter at one detection (b in Meyer et al. 2018).
        birth_unexplained: A detection starts a component if its unexplained share is above this.
        confirm_existence: Existence probability from which a component is reported.
        confirm_hits: Detections it must have had by then.
        prune_existence: Below this existence probability a component is removed.
        occluder_existence: Components above this existence probability cast shadows.
        longest_unseen_s: A component unseen for longer is removed.
        unconfirmed_unseen_s: The same for one that was never confirmed.
        largest_std_lon_m: A component spread wider than this is removed.
        range_margin_m: A component further than this beyond the sensor's range is removed.
        resample_below: A component is resampled when its effective sample size falls below this share.
        kernel_width: Resampled particles are smoothed by a kernel as wide as this share of the component's spread
            (Liu and West 2001), so that little process noise does not impoverish the cloud.
        young_hits: Up to this many hits a component is resampled from its weighted Gaussian, since its speed is
            still uncertain.
        exclusion_strength: How strongly a hidden particle inside a seen track's footprint is discounted each 0.1 s.
        merge_lon_m: Two components nearer than this and ``merge_lat_m`` for ``merge_scans`` scans become one.
        merge_lat_m: See ``merge_lon_m``.
        merge_scans: See ``merge_lon_m``.
        stitch: Whether a newly confirmed component near a hidden one takes its identity.
        stitch_density: Density of vehicles that were never seen before, per m² and m/s: the hidden component must
            make the new one's place and speed more probable than that.
        stitch_lon_m: Width of the kernel around the hidden component's particles, longitudinal,
        stitch_lat_m: lateral, and
        stitch_speed_mps: in speed.
        stitch_both_seen_s: For this long the hidden one may have been seen after the new one's birth.
        shadow: Whether the detection probability depends on shadows; without, it is ``fixed_probability``.
        fixed_probability: See ``shadow``.
        exclusive: Whether a detection belongs to one component (belief propagation) or may serve several (PDA).
    """

    gate_std: Positive = 4.5
    missed_detection_cap: Probability = 0.6
    missed_from_fraction: Probability = 0.2
    missed_full_fraction: Probability = 0.8
    hidden_detection_probability: Probability = 0.02
    survival_probability: Probability = 0.999
    birth_density: Positive = 0.3
    birth_unexplained: Probability = 0.3
    confirm_existence: Probability = 0.6
    confirm_hits: Annotated[int, Field(ge=1)] = 3
    prune_existence: Probability = 0.02
    occluder_existence: Probability = 0.2
    longest_unseen_s: Positive = 10.0
    unconfirmed_unseen_s: Positive = 1.0
    largest_std_lon_m: Positive = 20.0
    range_margin_m: Annotated[float, Field(ge=0.0)] = 4.0
    resample_below: Probability = 0.3
    kernel_width: Probability = 0.4
    young_hits: Annotated[int, Field(ge=0)] = 20
    exclusion_strength: Annotated[float, Field(ge=0.0)] = 0.9
    merge_lon_m: Positive = 2.5
    merge_lat_m: Positive = 1.0
    merge_scans: Annotated[int, Field(ge=1)] = 3
    stitch: bool = True
    stitch_density: Positive = 3e-5
    stitch_lon_m: Positive = 2.0
    stitch_lat_m: Positive = 0.7
    stitch_speed_mps: Positive = 2.0
    stitch_both_seen_s: Annotated[float, Field(ge=0.0)] = 0.5
    shadow: bool = True
    fixed_probability: Probability = 0.5
    exclusive: bool = True


class MaxLikelihoodOptions(Settings):
    """The paper's own rule: each particle's likelihood is its largest over all detections.

    Attributes:
        gate_std: A component with no detection within this many standard deviations performs no measurement update.
            Infinite in the paper: the largest likelihood counts however small it is.
        removal_weight: r of the paper: a component whose weight falls below this share of the mean component weight
            is removed.
        floor_component_weight: Keeps component weights from falling below this share of the mean; zero is the
            paper's equation (11), whose product over time starves components.
        resample_below: A component is resampled when its effective sample size falls below this share.
        added_particles: a of the paper, as a share of one component's particles: a detection that fewer particles
            chose starts a component.
        merge_lon_m: Components whose means are nearer than this and ``merge_lat_m`` overlap significantly.
        merge_lat_m: See ``merge_lon_m``.
        touch_lon_m: Components nearer than this and ``touch_lat_m`` are reclustered together by k-medoids.
        touch_lat_m: See ``touch_lon_m``.
        medoid_sample: Particles of a group that vote on the medoids; the rest follow the nearest one.
        shadowed_share: Share of its extent in shadow from which a component counts as completely occluded.
        confirm_hits: Scans with an update before a component is reported.
        longest_unseen_s: A component unseen for longer is removed.
        range_margin_m: A component further than this beyond the sensor's range has left the observation area.
    """

    gate_std: Positive = float("inf")
    removal_weight: Probability = 0.0
    floor_component_weight: Probability = 0.0
    resample_below: Probability = 0.5
    added_particles: Probability = 0.1
    merge_lon_m: Positive = 2.5
    merge_lat_m: Positive = 1.0
    touch_lon_m: Positive = 7.0
    touch_lat_m: Positive = 2.5
    medoid_sample: Annotated[int, Field(ge=10)] = 200
    shadowed_share: Probability = 0.85
    confirm_hits: Annotated[int, Field(ge=1)] = 3
    longest_unseen_s: Positive = 10.0
    range_margin_m: Annotated[float, Field(ge=0.0)] = 4.0


class FilterOptions(Settings):
    """All settings of the Modified Mixture Particle Filter.

    Attributes:
        particles: Particles per component.
        update: ``joint``, or ``max_likelihood`` for the rule of the paper.
        vehicle: Size of a vehicle before it is measured.
        model_error: Noise added to the motion model's prediction.
        birth: How new components are drawn.
        reporting: When a component counts as hidden and which hidden ones are reported.
        joint: Settings that only the joint update reads.
        max_likelihood: Settings that only the paper's update reads.
    """

    particles: Annotated[int, Field(ge=10, le=1_000_000)] = 1000
    update: UpdateName = "joint"
    vehicle: Footprint = Footprint()
    model_error: ModelErrorOptions = ModelErrorOptions()
    birth: BirthOptions = BirthOptions()
    reporting: ReportingOptions = ReportingOptions()
    joint: JointOptions = JointOptions()
    max_likelihood: MaxLikelihoodOptions = MaxLikelihoodOptions()


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
