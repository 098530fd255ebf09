"""Which links of a lane graph vehicles may enter now, as far as a tracker can tell.

A signal's state is known where the scan says it. Elsewhere it is inferred from who is seen to drive and to wait. Who
has to give way is held by those who come.
"""

from typing import NamedTuple

import numpy as np

from mmpf.map.control import SIGNAL, YIELD, LinkControl
from mmpf.map.lane_graph import LaneColumns, LaneGraph
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel

# A signal of which nothing is seen any more is forgotten over this time.
FORGOTTEN_S = 15.0
# Log odds a second that a link is open: by who is seen to enter it, or one that crosses it, or to wait before it.
ENTERED_PER_S, CROSSED_PER_S, WAITED_PER_S = 8.0, -8.0, -2.0
MOST_LOG_ODDS = 4.0
# Drivers start late at green and pass at yellow: these shares go at signals that are told to be closed and open.
GOES_AT_CLOSED, GOES_AT_OPEN = 0.1, 0.95
# The other signals of an approach are often of the same phase.
BESIDE = 0.5
# Entering are those who drive so fast, so far behind the line; waiting those who are slower, so near before it.
DRIVES_MPS, WAITS_MPS, NEAR_M = 3.0, 1.0, 12.0
# Who has to give way goes if nobody with right of way arrives within this time, and few go all the same.
GAP_S = 3.0
HELD, CLEAR = 0.3, 0.95
SLOWEST_MPS = 0.5
# Who is farther along the path across than this share of it holds nobody any more.
CROSSED_SHARE = 0.7


class OnLanes(NamedTuple):
    """Vehicles on the lanes, struct of arrays over v vehicles.

    Attributes:
        lane: Lane of each, negative for one that is on none.
        along_m: Arc length of its middle.
        speed_mps: Speed.
        length_m: Length.
        seen: Whether it was seen lately.
    """

    lane: IntArray
    along_m: FloatArray
    speed_mps: FloatArray
    length_m: FloatArray
    seen: BoolArray


class SignalEstimator:
    """Which links of a graph can be taken, as watched from scan to scan.

    Attributes:
        log_odds: Log odds that each link's signal is open, by who was seen to drive and to wait, shape (k,).
    """

    def __init__(self, graph: LaneGraph) -> None:
        """Begin to watch; nothing has been seen."""
        self._graph, self.log_odds = graph, np.zeros(len(graph.successor))

    def look(self, vehicles: OnLanes, open_signals: BoolArray | None, dt_s: float) -> FloatArray | None:
        """Return how probably each link can be taken now, shape (k,); None where nothing is known of links.

        Args:
            vehicles: Where vehicles are.
            open_signals: State of each signal, where it is known, shape (signals,).
            dt_s: Time since the look before.
        """
        control = self._graph.control
        if control is None:
            return None
        if control.signal_name:
            self._watch(vehicles, control, dt_s)
        chance = 1.0 / (1.0 + np.exp(-self.log_odds))
        if open_signals is not None and len(open_signals):
            chance = np.where(open_signals[control.signal], GOES_AT_OPEN, GOES_AT_CLOSED)
        chance = np.where(control.kind == SIGNAL, chance, 1.0)
        _give_way(chance, vehicles, control.kind, control.foe, control.first_foe, self._graph.columns)
        return chance

    def _watch(self, vehicles: OnLanes, control: LinkControl, dt_s: float) -> None:
        """Learn from who drives and who waits."""
        graph, after = self._graph, self.log_odds * np.exp(-dt_s / FORGOTTEN_S)
        drives = vehicles.seen & (vehicles.speed_mps > DRIVES_MPS) & (vehicles.along_m < NEAR_M)
        entered = np.isin(graph.successor, vehicles.lane[drives]) & (control.kind == SIGNAL)
        _watch_drivers(after, dt_s, entered, control.kind, control.foe, control.first_foe, graph.columns)
        ends = np.where(vehicles.lane >= 0, graph.length_m[vehicles.lane], np.inf)
        at_line = ends - vehicles.along_m - 0.5 * vehicles.length_m < NEAR_M
        waits = vehicles.seen & (vehicles.speed_mps < WAITS_MPS) & (vehicles.lane >= 0) & at_line
        held = np.bincount(vehicles.lane[waits], minlength=len(graph))[graph.link_from]
        after += np.where(control.kind == SIGNAL, WAITED_PER_S * dt_s * held, 0.0)
        self.log_odds = np.clip(after, -MOST_LOG_ODDS, MOST_LOG_ODDS)


@kernel()
def _watch_drivers(
    log_odds: FloatArray,
    dt_s: float,
    entered: BoolArray,
    kind: IntArray,
    foe: IntArray,
    first_foe: IntArray,
    lanes: LaneColumns,
) -> None:
    """Raise the log odds of signals that were passed and of those beside them, lower those of crossing ways."""
    _, _, left_of, right_of, _, first_successor, link_from, _ = lanes
    for k in range(len(kind)):
        if kind[k] != SIGNAL:
            continue
        for f in range(first_foe[k], first_foe[k + 1]):
            pair_again = foe[f] < k and k in foe[first_foe[foe[f]] : first_foe[foe[f] + 1]]
            if kind[foe[f]] == SIGNAL and not pair_again:
                log_odds[k] += CROSSED_PER_S * dt_s * entered[foe[f]]
                log_odds[foe[f]] += CROSSED_PER_S * dt_s * entered[k]
        if not entered[k]:
            continue
        log_odds[k] += ENTERED_PER_S * dt_s
        for beside in (link_from[k], left_of[link_from[k]], right_of[link_from[k]]):
            if beside < 0:
                continue
            for other in range(first_successor[beside], first_successor[beside + 1]):
                log_odds[other] += BESIDE * ENTERED_PER_S * dt_s * (kind[other] == SIGNAL and not entered[other])


@kernel()
def _give_way(
    chance: FloatArray,
    vehicles: OnLanes,
    kind: IntArray,
    foe: IntArray,
    first_foe: IntArray,
    lanes: LaneColumns,
) -> None:
    """Lower the chance of links whose vehicles must wait for who comes or crosses, raise it where nobody does."""
    lane, along, speed, _, _ = vehicles
    lane_length, _, _, _, successor, _, link_from, in_junction = lanes
    for k in range(len(kind)):
        if kind[k] != YIELD:
            continue
        held = False
        for f in range(first_foe[k], first_foe[k + 1]):
            way, path = link_from[foe[f]], successor[foe[f]]
            if kind[foe[f]] == SIGNAL and chance[foe[f]] < 0.5:
                way = -1
            for v in range(len(lane)):
                if lane[v] < 0:
                    continue
                if lane[v] == way:
                    held |= lane_length[way] - along[v] < GAP_S * max(speed[v], SLOWEST_MPS)
                elif lane[v] == path and in_junction[path]:
                    held |= along[v] < CROSSED_SHARE * lane_length[path]
        chance[k] = HELD if held else CLEAR
