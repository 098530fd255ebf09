"""The settings that only the joint update reads."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from mmpf.settings import NotNegative, Positive, Probability, Settings, in_unit


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


class JointReach(Settings):
    """How well the sensor sees at each distance."""

    learned: bool = True
    """Whether it is counted at which distances vehicles are detected; without, the data sheet holds everywhere."""
    memory_s: Positive = 60.0
    """Detections count for about so long."""
    prior_scans: Positive = 20.0
    """So many detections the data sheet itself counts for, in each of the rings around the sensor."""


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
    overlap_share: NotNegative = 0.6
    """Two sources nearer than this share of a length and a width can't both be vehicles."""
    overlap_per_s: NotNegative = 3.0
    """Log odds that the lesser one of them loses a second."""
    confirm_log_odds: float = 0.5
    """Log odds of a vehicle above which a component may be reported."""
    withdraw_log_odds: float = -1.5
    """Log odds below which it is no longer reported."""


class JointFalseObjects(Settings):
    """What false objects are like."""

    seen_probability: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.6
    """Probability that a false object in plain view is detected in a scan."""
    life_s: Positive = 3.0
    """Mean life of a false object."""
    standing_share: Probability = 0.7
    """Share of false objects that stand still; the others move as traffic does."""
    standing_std_mps: Positive = 1.0
    """Spread of their speeds."""
    flow_std_mps: Positive = 4.0
    """Spread of vehicles' speeds around the traffic's."""
    waiting_share: Probability = 0.3
    """Share of vehicles that stand though others flow, in a plane of which no stop lines are known; along a single road
    none does.
    """
    waiting_share_at_line: Probability = 0.6
    """The same where a signal or right of way may hold vehicles a little ahead."""
    waiting_share_elsewhere: Probability = 0.15
    """The same where stop lines are known and none is ahead."""


class JointRegularity(Settings):
    """How regular detections and misses tell vehicles from false objects."""

    shadow_wrong: Probability = 0.5
    """Probability that a vehicle is seen as if no shadow lay on it: neither the shadows nor what they do to the sensor
    are exactly known.
    """
    shadow_wrong_s: Positive = 2.0
    """What detections have said of that is forgotten over this time."""
    largest_miss_log_odds: NotNegative = 0.25
    """Log odds that a miss in shadow adds at most, since a shadow may lie on a false object too."""
    gap_credit: Probability = 0.5
    """Share of the log odds of a false object's misses that a vehicle gets back when it is seen again."""
    largest_gap_scans: NotNegative = 6.0
    """So many of its misses count at most."""


class JointManoeuvres(Settings):
    """What drivers may do that the motion model does not foresee; see ``mmpf.motion.manoeuvring``."""

    begin_per_s: NotNegative = 0.2
    """Rate at which particles of vehicles in sight begin a manoeuvre; 0 for a motion model that is always right."""
    mean_s: Positive = 2.0
    """Mean length of a manoeuvre; it ends with sight."""
    accel_std_mps2: NotNegative = 3.0
    """Standard deviation of its acceleration around the present one, within what tyres and engines do."""


class JointNoise(Settings):
    """How the noise of detections is learned from the innovations."""

    learned: bool = True
    """Whether it is; without, detections are believed as they report themselves."""
    memory_s: Positive = 2.0
    """Innovations count for about so long."""
    smallest_std_m: NotNegative = 0.04
    """No detection is taken as more exact than that: however exact a range, where a partly seen vehicle's centre lies
    is not.
    """
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
    after_s: NotNegative = 0.27
    """Components that overlap in scan after scan become one when that lasts longer, the time before the first of these
    scans included.
    """


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
    reach: JointReach = JointReach()
    """How well the sensor sees at each distance."""
    association: JointAssociation = JointAssociation()
    """Which detection may belong to which component."""
    existence: JointExistence = JointExistence()
    """Whether a component is a vehicle."""
    ghosts: JointGhosts = JointGhosts()
    """Whether it is a vehicle or a false object."""
    false_objects: JointFalseObjects = JointFalseObjects()
    """What false objects are like."""
    regularity: JointRegularity = JointRegularity()
    """How regular detections tell them apart."""
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
