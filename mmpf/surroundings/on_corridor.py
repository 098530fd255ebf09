"""Road and traffic around each particle on a corridor, from lanes, other components and the ego.

Who leads and who follows whom is settled between component means, lane by lane, and in the own lane by who is in the
way; the gap is then each particle's own. Off every lane, as on a ramp, there are no lines and nobody to follow.

Who may be a false object is heeded by as many particles as it is probably a vehicle (``mmpf.motion.doubting``): else a
false object in the lane would make all particles of the vehicle behind it brake.
"""

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.map.corridor_road import CorridorRoad
from mmpf.motion.doubting import DOUBT
from mmpf.motion.protocol import Surroundings
from mmpf.motion.state import ACCEL, LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray
from mmpf.scan import EgoPose
from mmpf.surroundings.adjacent_lanes import LEFT, OWN, RIGHT, lanes_around
from mmpf.surroundings.neighbours import KnownTraffic, UnmeasuredNeighbour, nearest_by_lane

LEAST_PROBABILITIES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""For each fifth of the doubts from 0 to 1: particles heed who is a vehicle with more than this probability."""


def surroundings_of(
    mixture: Mixture,
    moments: Moments,
    is_seen: BoolArray,
    ego: EgoPose,
    ego_accel_mps2: float,
    road: CorridorRoad,
) -> Surroundings:
    """Return what each particle knows of road and traffic.

    Args:
        mixture: The belief, whose particles have doubts; its confirmed components count as vehicles for the others.
        moments: Its components' moments.
        is_seen: Components that were seen lately, shape (m,).
        ego: Pose of the sensor's own vehicle, a neighbour like any other.
        ego_accel_mps2: Its longitudinal acceleration.
        road: The lanes.
    """
    state, component, vehicles = mixture.cloud.state, mixture.cloud.component, mixture.components
    own = ego.lon_m, ego.lat_m, ego.speed_mps, 0.0, ego_accel_mps2, 0.0
    # Rows of other strides would have the kernel compiled once more.
    others = np.ascontiguousarray(np.column_stack([moments.mean, own]))
    length, width = np.append(vehicles.length_m, ego.length_m), np.append(vehicles.width_m, ego.width_m)
    lane_of_other = road.lane_index_at(others[LON], others[LAT])
    probability = np.append(np.where(vehicles.confirmed, vehicles.vehicle_share, 0.0), 1.0)
    cases = [
        nearest_by_lane(others[LON], others[LAT], width, lane_of_other, probability > least, len(road.lanes))
        for least in LEAST_PROBABILITIES
    ]
    leader, follower = (np.concatenate(tables) for tables in zip(*cases, strict=True))
    row = (mixture.cloud.latents[DOUBT] * len(cases)).astype(np.int64)
    row *= len(length)
    row += component

    lanes = lanes_around(state[LON], state[LAT], road)
    known = KnownTraffic(state, row, others[[LON, SPEED, ACCEL]], np.tile(length, len(cases)))
    return Surroundings(
        length_m=vehicles.length_m[component],
        lane_right_m=lanes.line_m[0],
        lane_left_m=lanes.line_m[1],
        has_left_lane=lanes.has_beside[0],
        has_right_lane=lanes.has_beside[1],
        leader=known.measured(lanes.lane[OWN], leader, 1.0),
        left_leader=UnmeasuredNeighbour(known, lanes.lane[LEFT], leader, 1.0),
        left_follower=UnmeasuredNeighbour(known, lanes.lane[LEFT], follower, -1.0),
        right_leader=UnmeasuredNeighbour(known, lanes.lane[RIGHT], leader, 1.0),
        right_follower=UnmeasuredNeighbour(known, lanes.lane[RIGHT], follower, -1.0),
        is_hidden=np.repeat(~is_seen, np.diff(mixture.starts)),
        road_speed_mps=np.broadcast_to(np.inf, len(component)),
    )
