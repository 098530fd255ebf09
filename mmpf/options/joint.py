"""The settings that only the joint update reads."""

from __future__ import annotations

import math
from typing import Annotated

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
    largest: Probability = 0.9999
    """No component is more certain than this. Whoever was tracked for long is there, but for ``death_rate_per_s``: a
    lower bound here would be doubt that comes back in every scan, and a few misses in a shadow would make it grow.
    """
    report_above: Probability = 0.6
    """Probability that there is a source at all above which a component may be reported."""
    confirm_s: NotNegative = 0.2
    """Time after its first detection for which a component must have been detected before it is reported; each
    detection counts for the time since the scan before.
    """
    same_place_share: NotNegative = 0.75
    """Nearer than this share of a length and a width to a confirmed component whose place is known, none is
    confirmed.
    """
    known_place_std_lon_m: NotNegative = 1.0
    """A component that is spread less than this has a known place."""


class JointKinds(Settings):
    """Whether a source of detections is a vehicle or a false object that stays; see ``mmpf.joint.kinds``."""

    weighed: bool = True
    """Whether the question is asked; without, everything that exists is a vehicle."""
    least_prior: Annotated[float, Field(gt=0.0, lt=0.5), in_unit("probability")] = 0.02
    """No place of appearance makes either kind less probable than this."""
    largest_log_odds: Positive = 6.0
    """No log odds between vehicle and false object grow beyond this."""
    overlap_share: NotNegative = 0.6
    """Two sources nearer than this share of a length and a width can't both be vehicles."""
    overlap_per_s: NotNegative = 3.0
    """Log odds that the lesser one of them loses a second."""
    confirm_above: Probability = 0.5
    """Probability of a vehicle above which a component is reported."""
    withdraw_below: Probability = 0.2
    """Probability of a vehicle, if there is a source at all, below which it is no longer reported."""


class JointVehicles(Settings):
    """What vehicles are like to the sensor before any was seen."""

    detectability: Levels = (0.02, 0.03, 0.04, 0.06, 0.10, 0.25, 0.50)
    """Share of vehicles at each level (``mmpf.joint.kinds.DETECTABILITY``): dark paint, motorcycles."""
    prior_count: Annotated[Positive, in_unit("vehicles")] = 30.0
    """So many vehicles these shares count for; the vehicles around add to them."""
    shading: Shadings = (0.5, 0.3, 0.2)
    """Share of vehicles on whose detection shadows have their whole effect, half of it as a power, and none: neither
    shadows nor what they do to the sensor are exactly known.
    """
    shading_s: Positive = 2.0
    """What detections have said of that is forgotten over this time."""


class JointNewborn(Settings):
    """Where vehicles are first detected, and how many."""

    appear_in_view_per_s: Positive = 0.05
    """Vehicles a second that are first detected in plain view, where they should have been known before, before any
    was counted.
    """
    prior_appear_s: Positive = 3.0
    """So many seconds that rate counts for; the vehicles that are found add to it."""
    appear_out_of_view_per_s: Positive = 4.0
    """The same at a shadow's or the range's edge, or in the first scan: as if all range were such a place."""
    appear_in_shadow: Probability = 0.1
    """What remains of that rate deep in a shadow, where no vehicle should be detected."""
    overlooked_share: Probability = 0.3
    """Share of those first detected in plain view that had been overlooked because they are hard to detect."""
    first_look_s: Positive = 1.0
    """After the first scan it takes about so long until what is in plain view has been detected."""
    edge_m: Positive = 8.0
    """Width of the range's edge."""
    shadow_edge_s: NotNegative = 0.5
    """For so long a vehicle may have been out of a shadow before it is detected: the ego passes what stands at its own
    speed.
    """


class JointFalseObjects(Settings):
    """What false objects are like before any was found, and how fast that is learned."""

    birth_share: Annotated[Positive, in_unit("1/s for each false detection in a scan")] = 0.3
    """Rate at which false objects appear, in relation to the data sheet's false detections in a scan: as if half of
    these came from objects that last ``life_s``.
    """
    standing_share: Probability = 0.75
    """Share of false objects that stand still; the others move as traffic does."""
    life_s: Positive = 2.5
    """Mean life."""
    detectability: Levels = (0.12, 0.17, 0.23, 0.26, 0.16, 0.05, 0.01)
    """Share of false objects at each level of detectability."""
    shading: Shadings = (0.3, 0.2, 0.5)
    """The same shares among false objects: some are seen through vehicles."""
    prior_count: Annotated[Positive, in_unit("false objects")] = 4.0
    """So many false objects the figures above count for."""
    prior_watched_s: Positive = 3.0
    """So many seconds the rate above counts for."""
    memory_s: Positive = 60.0
    """False objects count for about so long."""


class JointSpeeds(Settings):
    """What speeds say of the kind of a source."""

    standing_std_mps: Positive = 1.0
    """Spread of the speeds of what stands."""
    flow_std_mps: Positive = 4.0
    """Spread of vehicles' speeds around the traffic's."""
    stopped_on_road: Probability = 0.1
    """Share of vehicles that stand though others flow, along a single road: broken-down cars, ends of queues."""
    stopped_in_plane: Probability = 0.3
    """The same in a plane of which no stop lines are known."""
    stopped_at_line: Probability = 0.6
    """The same where a signal or right of way may hold vehicles a little ahead."""
    stopped_elsewhere: Probability = 0.15
    """The same where stop lines are known and none is ahead."""


class JointPath(Settings):
    """The ego's path: what lies in it is always reported, with its probability."""

    margin_m: NotNegative = 0.3
    """Room beside the ego's body and the other's that the path takes in."""
    gap_m: NotNegative = 10.0
    """Length of the path where the ego stands."""
    reaction_s: NotNegative = 1.0
    """Time that passes before the ego brakes."""
    braking_mps2: Positive = 3.0
    """Deceleration with which it then stops."""


class JointManoeuvres(Settings):
    """What drivers may do that the motion model does not foresee; see ``mmpf.motion.manoeuvring``."""

    begin_per_s: NotNegative = 0.5
    """Rate at which particles of vehicles in sight begin a manoeuvre; 0 for a motion model that is always right."""
    true_per_s: NotNegative = 0.02
    """Rate at which drivers do: a particle that tries it weighs less by the ratio of the two rates."""
    mean_s: Positive = 2.0
    """Mean length of a manoeuvre; it ends with sight."""
    accel_std_mps2: NotNegative = 4.5
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
    young_s: NotNegative = 2.0
    """Until it was detected for this time a component is resampled from its weighted Gaussian, since its speed is still
    uncertain; each detection counts for the time since the scan before.
    """
    young_effective_share: Probability = 0.9
    """Takes the place of ``effective_share`` for such a component."""


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
