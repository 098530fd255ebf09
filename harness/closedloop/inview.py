"""Finds vehicles in plain view in the ego's lane: one that will stop, or a leader that is rarely detected."""

from dataclasses import dataclass, replace

import numpy as np

from harness.closedloop.sight import SEEN_EVERY, visible_fraction
from harness.closedloop.traffic import LiveTraffic
from harness.config.sensor import SensorSettings
from harness.decisions.belief import Belief
from harness.sensor.detector import own_shadows
from harness.sensor.observation import Observation, Sensor
from harness.truth.frame import Frame
from harness.truth.sumo.brokendown import placed
from harness.truth.sumo.fill import Placement
from harness.truth.sumo.population import Vehicle
from mmpf.map.road import Road
from mmpf.scan import SensorModel

CHANGES_LANE_MPS = 0.2
"""Whoever moves sideways faster is about to be somewhere else."""
FARTHEST_LEADER_M = 40.0
BEYOND_RANGE_M = 10.0
"""A vehicle that is to stand ahead is so far beyond the sensor's range when it is put there."""
NOBODY_BEYOND_M = 15.0
BESIDE_M = 2.7
"""Whoever has its middle nearer to the ego's across the road is in its way, or may soon be."""
FROM_EDGE_END_M = 6.0
AT_FLOW_SHARE = 0.15
"""An ego's speed differs by no more than this share from that at which the traffic is to flow."""
PLAIN_VIEW = 0.8
SLOWEST_LEADER_MPS = 5.0


def stands_ahead(
    traffic: LiveTraffic, row: int, range_m: float, vehicle: Vehicle, flow_mps: float | None
) -> Placement | None:
    """Return where a vehicle can be put that stands in a car's lane, out of its sensor's range but soon in plain view.

    Args:
        traffic: The traffic.
        row: Row of the present frame that is the ego's.
        range_m: The sensor's range.
        vehicle: The vehicle that is to stand there.
        flow_mps: Speed at which the traffic is to flow; None for any.

    Returns:
        Where; None where somebody is between, or the road ends, or the ego is no part of the flow.
    """
    now, network = traffic.frames[-1], traffic.network
    speed_mps, front_m = float(now.speed_mps[row]), float(now.lon_m[row] + 0.5 * now.length_m[row])
    if flow_mps is not None and abs(speed_mps - flow_mps) > AT_FLOW_SHARE * flow_mps:
        return None
    rear_m = front_m + range_m + BEYOND_RANGE_M
    ahead_m = now.lon_m - now.lon_m[row]
    near = (ahead_m > 0.0) & (now.lon_m < rear_m + vehicle.length_m + NOBODY_BEYOND_M)
    across_m = np.abs(now.lat_m - now.lat_m[row])
    comes = (across_m < 2.0 * BESIDE_M) & (np.abs(now.lat_speed_mps) > CHANGES_LANE_MPS)
    if (near & ((across_m < BESIDE_M) | comes)).any() or rear_m + vehicle.length_m > network.section_m[1]:
        return None
    sumo, corridor = traffic.running.sumo.vehicle, network.main_road
    ego = str(now.vehicle_id[row])
    edges = {edge.name: edge for edge in corridor.edges}
    on = sumo.getRoadID(ego)
    if on not in edges:
        return None
    lane = int(sumo.getLaneIndex(ego)) - edges[on].extra_lanes
    stands = placed(network, lane, rear_m + vehicle.length_m, vehicle, FROM_EDGE_END_M)
    stands_m = edges[stands.edge].start_m + stands.position_m - vehicle.length_m
    return stands if 0 <= lane < corridor.main_lanes and stands_m > front_m + range_m else None


def leader_in_view(traffic: LiveTraffic, belief: Belief, place: int, row: int, settings: SensorSettings) -> str:
    """Return the leader of a car if it drives near ahead and has been in plain view throughout; else an empty name.

    The car is at a row of the present frame and at a place of those whose belief by the truth is given.
    """
    now, leaders = traffic.frames[-1], belief.leaders
    body, gap_m = int(leaders.body[place, 0]), float(leaders.gap_m[place, 0])
    if body < 0 or not 0.0 < gap_m <= FARTHEST_LEADER_M:
        return ""
    other = body % len(now)
    ego, name = str(now.vehicle_id[row]), str(now.vehicle_id[other])
    if now.speed_mps[other] < SLOWEST_LEADER_MPS or abs(now.lat_speed_mps[other]) > CHANGES_LANE_MPS:
        return ""
    looked = (frame for frame in list(traffic.frames)[::-SEEN_EVERY])
    plain = (visible_fraction(frame, ego, name, traffic.network.road, settings) >= PLAIN_VIEW for frame in looked)
    return name if all(plain) else ""


@dataclass(frozen=True)
class SeldomDetected:
    """A sensor that detects one vehicle, which no tracker knows, in a share of the scans in which another would."""

    sensor: Sensor
    vehicle: str
    share: float
    settings: SensorSettings

    def model(self, road: Road | None = None) -> SensorModel:
        """Return the data sheet, which does not state it; see ``Sensor``."""
        return self.sensor.model(road)

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:
        """Look at the frame; see ``Sensor``."""
        seen = self.sensor.observe(frame, road, rng)
        missed = bool(rng.random() >= self.share)
        kept = ~(missed & (seen.truth_id == self.vehicle))
        if kept.all():
            return seen
        seen = seen.with_detections(np.flatnonzero(kept))
        free = own_shadows(self.settings, seen.scan.detections, seen.scan.ego, road)
        return replace(seen, scan=replace(seen.scan, free_space=free))
