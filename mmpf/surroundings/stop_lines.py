"""Stop lines: a particle whose next link is closed follows a virtual leader that stands there."""

from mmpf.map.lane_graph import LaneColumns
from mmpf.motion.protocol import Neighbour
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.numerics.kernels import kernel

# Who would have to brake harder than this before a stop line goes on; the others stand so far before it.
STOPS_WITH_MPS2, BEFORE_LINE_M = 3.5, 1.0
# What is left to a leader that stands.
STANDSTILL_GAP_M = 2.0


@kernel()
def stop_at_lines(
    chance: FloatArray,
    gate: FloatArray,
    lane: IntArray,
    following: IntArray,
    along: FloatArray,
    own_speed: FloatArray,
    own_length: FloatArray,
    lanes: LaneColumns,
    leader: Neighbour,
) -> None:
    """Put a standing leader at the end of lanes whose next link a particle takes for closed, in place.

    Args:
        chance: How probably each link can be taken, shape (k,).
        gate: What each of n particles takes links for: open below this chance, shape (n,).
        lane: Its lane, negative for none, shape (n,).
        following: The lane that it takes next, negative for none, shape (n,).
        along: Where it is on its lane, metres, shape (n,).
        own_speed: Its speed, m/s, shape (n,).
        own_length: Its length, metres, shape (n,).
        lanes: The l lanes.
        leader: The particles' leaders, which are rewritten.
    """
    lane_length, successor, first_successor = lanes.length_m, lanes.successor, lanes.first_successor
    exists, gap, neighbour_speed, neighbour_accel, neighbour_length = leader
    for n in range(len(lane)):
        if lane[n] < 0 or following[n] < 0:
            continue
        for k in range(first_successor[lane[n]], first_successor[lane[n] + 1]):
            if successor[k] != following[n]:
                continue
            to_line = lane_length[lane[n]] - along[n] - 0.5 * own_length[n]
            if gate[n] < chance[k] or to_line < 0.0 or own_speed[n] ** 2 > 2.0 * STOPS_WITH_MPS2 * to_line:
                break
            away = to_line + STANDSTILL_GAP_M - BEFORE_LINE_M
            if not exists[n] or away < gap[n]:
                exists[n], gap[n], neighbour_speed[n], neighbour_accel[n] = True, away, 0.0, 0.0
                neighbour_length[n] = own_length[n]
            break
