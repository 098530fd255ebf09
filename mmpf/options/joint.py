"""Settings of the joint update only."""

import math
from typing import Annotated, Self

from pydantic import Field

from mmpf.options.base import NotNegative, Positive, Probability, Settings, in_unit

Levels = Annotated[
    tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative], in_unit("share")
]
"""The share of each level of detectability; see ``mmpf.joint.kinds.DETECTABILITY``."""
Shadings = Annotated[tuple[Positive, Positive, Positive], in_unit("share")]
"""The share of sources on whose detection shadows have their whole effect, half of it, and none."""


class JointDetectability(Settings):
    """How probably a vehicle is detected where it is, and what "not seen" is worth."""

    shadow: bool = True
    """Whether the detection probability depends on shadows; otherwise it is ``fixed_probability``."""
    fixed_probability: Probability = 0.5
    """Detection probability everywhere if ``shadow`` is false."""
    hidden_probability: Probability = 0.02
    """Detection probability of a particle that lies in shadow."""
    run_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.12
    """Expected share of time in runs of misses that no shadow explains."""
    run_s: Positive = 0.8
    """Mean length of such a run."""


class JointReach(Settings):
    """How well the sensor sees at each distance."""

    learned: bool = True
    """Whether detection probability by distance is learned from counts; otherwise the data sheet applies everywhere."""


class JointAssociation(Settings):
    """Which detection may belong to which component, and which to a new one."""

    gate_std: Positive = 4.5
    """A detection counts for a component within this many standard deviations."""
    exclusive: bool = True
    """Whether a detection belongs to one component (belief propagation) or may serve several (PDA)."""
    hit_probability: Probability = 0.5
    """A component counts as detected if its probability of a detection exceeds this."""
    clutter_memory_s: Positive | None = 10.0
    """Time constant for counting false detections, starting from the data sheet's rate; None always uses that rate."""
    birth_density: Annotated[Positive, in_unit("births per false detection")] = 0.3
    """Expected newborn vehicles relative to clutter at one detection (b in Meyer et al. 2018)."""
    birth_unexplained: Probability = 0.3
    """A detection starts a component if its unexplained share is above this."""
    exclusion_per_s: NotNegative = 9.0
    """Rate at which a hidden particle inside a detected track's footprint loses weight."""


class JointExistence(Settings):
    """Whether a component is a vehicle, and when it is believed."""

    death_rate_per_s: NotNegative = -10.0 * math.log(0.999)
    """Rate at which vehicles disappear; the default is one in a thousand per 0.1 s."""
    largest: Probability = 0.9999
    """Largest existence probability. A lower bound would restore doubt in every scan, and a few misses in a shadow
    would make it grow; ``death_rate_per_s`` already models disappearance.
    """
    confirm_s: NotNegative = 0.2
    """Detected time that a component needs after its first detection before it is reported; each detection adds the
    time since the previous scan.
    """


class JointKinds(Settings):
    """Whether a source of detections is a vehicle or a false object that stays; see ``mmpf.joint.kinds``."""

    weighed: bool = True
    """Whether the filter distinguishes vehicles from false objects; otherwise everything that exists is a vehicle."""
    moved_s: NotNegative = 0.7
    """Detected time after which an object that has moved is reported down to ``withdraw_moved_below``."""
    largest_log_odds: Positive = 6.0
    """Bound on the log odds between vehicle and false object."""
    score_correlation: Probability = 0.5
    """Correlation between the log odds of two scores of one object: 0 counts each score in full, 1 only their mean.
    On KITTI's sequences outside its validation set it is 0.40 to 0.48.
    """
    confirm_above: Probability = 0.5
    """Vehicle probability above which a component is reported."""
    withdraw_below: Probability = 0.2
    """Vehicle probability, given existence, below which a component outside the ego's path is not reported."""
    withdraw_moved_below: Probability = 0.15
    """The same for an object that has moved: it may be a vehicle that took over the track of a false object."""


class JointVehicles(Settings):
    """What vehicles are like to the sensor before any was seen."""

    detectability: Levels = (0.02, 0.03, 0.04, 0.06, 0.10, 0.25, 0.50)
    """Share of vehicles at each level (``mmpf.joint.kinds.DETECTABILITY``): dark paint, motorcycles."""
    prior_count: Annotated[Positive, in_unit("vehicles")] = 30.0
    """Weight of these shares as a prior, in vehicles; observed vehicles update them."""
    shading: Shadings = (0.5, 0.3, 0.2)
    """Shares of vehicles for which shadows have their full effect on detection, half of it (as an exponent), and none:
    shadows and their effect are not exactly known.
    """
    shading_s: Positive = 2.0
    """Time constant with which the evidence for these shares is forgotten."""


class JointNewborn(Settings):
    """Where vehicles are first detected, and how many."""

    overlooked_share: Probability = 0.3
    """Share of vehicles first detected in plain view that were missed before because they are hard to detect."""
    in_view_per_s: Positive = 0.05
    """Rate of vehicles first detected in plain view, before any was counted; counts can only raise it."""


class JointFalseObjects(Settings):
    """What false objects are like before any was found, and how fast that is learned."""

    birth_share: Annotated[Positive, in_unit("1/s for each false detection in a scan")] = 0.3
    """Rate at which false objects appear before any was counted, per false detection in a scan, as learned so far. The
    default assumes that half of these come from objects with lifetime ``life_s``.
    """
    standing_share: Probability = 0.75
    """Share of false objects that do not move; the others move with the traffic."""
    life_s: Positive = 2.5
    """Mean lifetime."""
    detectability: Levels = (0.12, 0.17, 0.23, 0.26, 0.16, 0.05, 0.01)
    """Share of false objects at each level of detectability."""
    shading: Shadings = (0.3, 0.2, 0.5)
    """The same shares among false objects; some are detected through vehicles."""
    prior_count: Annotated[Positive, in_unit("false objects")] = 4.0
    """Weight of the values above as a prior, in false objects."""
    prior_watched_s: Positive = 3.0
    """Weight of the rate above as a prior, in seconds."""
    memory_s: Positive = 60.0
    """Time constant with which counted false objects are forgotten."""


class JointSpeeds(Settings):
    """What speeds say of the kind of a source."""

    stopped_on_road: Probability = 0.15
    """Share of standing vehicles in flowing traffic, on a single road: broken-down cars, ends of queues."""


class JointPath(Settings):
    """The ego's path: what lies in it is always reported, with its probability."""

    margin_m: NotNegative = 0.3
    """Lateral margin of the path on each side of the two vehicles."""
    gap_m: NotNegative = 10.0
    """Length of the path at zero ego speed."""
    reaction_s: NotNegative = 1.0
    """Reaction time before the ego brakes."""
    braking_mps2: Positive = 3.0
    """Deceleration with which the ego then stops."""
    beside_m: NotNegative = 8.0
    """What is nearer than this to the ego's side counts as ahead if the ego reaches it before it can stop."""
    confirm_ahead_above: Probability = 0.2
    """Vehicle probability above which a component ahead is reported, in place of ``kinds.confirm_above``."""
    withdraw_ahead_below: Probability = 0.08
    """The same in place of ``kinds.withdraw_below``."""


class JointManoeuvres(Settings):
    """What drivers may do that the motion model does not foresee; see ``mmpf.motion.manoeuvring``."""

    begin_per_s: NotNegative = 0.5
    """Rate at which particles of visible vehicles begin a manoeuvre; 0 turns manoeuvres off."""
    true_per_s: NotNegative = 0.02
    """Rate at which real drivers begin one; a particle that begins one loses weight by the ratio of the two rates."""
    mean_s: Positive = 2.0
    """Mean duration of a manoeuvre; it ends when the vehicle is hidden."""
    accel_std_mps2: NotNegative = 4.5
    """Standard deviation of its acceleration around the present one, within physical limits."""


class JointNoise(Settings):
    """How the noise of detections is learned from the innovations."""

    learned: bool = True
    """Whether the noise is learned; otherwise the reported deviations are used."""


class JointRemoval(Settings):
    """When a component is let go."""

    longest_unseen_s: Positive = 10.0
    """A confirmed component without detections for longer is removed."""
    unconfirmed_unseen_s: Positive = 1.0
    """An unconfirmed component without detections for longer is removed."""
    largest_std_lon_m: Positive = 20.0
    """A component with a wider spread is removed."""


class JointResampling(Settings):
    """When the particles of a component are drawn anew, and how far they are smoothed."""

    effective_share: Probability = 0.3
    """A component is resampled when its effective sample size falls below this share of its particles."""
    kernel_width: Probability = 0.4
    """Resampled particles are smoothed by a kernel as wide as this share of the component's spread (Liu and West
    2001), so that little process noise does not impoverish the cloud.
    """
    young_s: NotNegative = 2.0
    """A component with less detected time is resampled from its weighted Gaussian, since its speed is still uncertain;
    each detection adds the time since the previous scan.
    """


class JointMerging(Settings):
    """When two components are one vehicle."""

    lon_m: Positive = 2.5
    """Components overlap if their means are nearer than this along the road and ``lat_m`` across it."""
    lat_m: Positive = 1.4
    """See ``lon_m``."""
    speed_mps: Positive = 4.0
    """Components whose speeds differ by more are not merged: the vehicles pass each other."""
    after_s: NotNegative = 0.27
    """Components that overlap in consecutive scans for longer are merged; the time before the first of these scans
    counts.
    """


class JointIdentity(Settings):
    """When a newly confirmed component is a hidden one, seen again, and takes its identity."""

    stitch: bool = True
    """Whether a new track takes over the identity of a hidden one."""
    unknown_density: Annotated[Positive, in_unit("1/(m² m/s)")] = 3e-5
    """Density of vehicles never detected before; the hidden component must explain the new position and speed with a
    higher density.
    """


class JointPlane(Settings):
    """What is different on a network in the plane: no map shows all that hides vehicles, or which way they point."""

    in_view_per_s: Positive = 0.2
    """There in place of ``newborn.in_view_per_s``: vehicles come out from behind buildings."""
    shading: Shadings = (0.4, 0.25, 0.35)
    """There in place of ``vehicles.shading``: shadows of bodies that may point any way are less exactly known."""
    confirm_above: Probability = 0.3
    """There in place of ``kinds.confirm_above``: parked cars can't tell by their speed that they are vehicles."""


class JointOptions(Settings):
    """Soft joint association: marginals by belief propagation, existence, births by unexplained detections."""

    detectability: JointDetectability = JointDetectability()
    """How probably a vehicle is detected where it is."""
    reach: JointReach = JointReach()
    """How well the sensor sees at each distance."""
    association: JointAssociation = JointAssociation()
    """Which detection may belong to which component."""
    existence: JointExistence = JointExistence()
    """Whether a component is a vehicle."""
    kinds: JointKinds = JointKinds()
    """Whether it is a vehicle or a false object."""
    vehicles: JointVehicles = JointVehicles()
    """What vehicles are like to the sensor."""
    newborn: JointNewborn = JointNewborn()
    """Where vehicles are first detected."""
    false_objects: JointFalseObjects = JointFalseObjects()
    """What false objects are like."""
    path: JointPath = JointPath()
    """Where the ego is about to drive."""
    speeds: JointSpeeds = JointSpeeds()
    """What speeds say of that."""
    manoeuvres: JointManoeuvres = JointManoeuvres()
    """What drivers may do that the motion model does not foresee."""
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
    plane: JointPlane = JointPlane()
    """What is different in the plane."""

    def in_plane(self) -> Self:
        """Return the settings with those of ``plane`` in their places."""
        plane = self.plane
        newborn = self.newborn.model_copy(update={"in_view_per_s": plane.in_view_per_s})
        vehicles = self.vehicles.model_copy(update={"shading": plane.shading})
        kinds = self.kinds.model_copy(update={"confirm_above": plane.confirm_above})
        return self.model_copy(update={"newborn": newborn, "vehicles": vehicles, "kinds": kinds})
