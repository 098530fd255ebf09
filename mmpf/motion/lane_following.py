"""Motion along the lanes of a graph: any motion model drives in the frame of its own lane.

Each particle carries the lane it is on and the one it means to take next. Particles of one vehicle that mean to take
different ways at a junction are hypotheses about its route, which the detections sort out.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mmpf.map.lane_graph import NOWHERE, LaneColumns, LaneGraph
from mmpf.motion.heading_measurements import drawn_directions
from mmpf.motion.protocol import AroundAnother, Surroundings, propagate_by_rewriting, step_in_place
from mmpf.motion.standing import drawn_standing, drift_in_place, hold_still
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.motion.turning import lane_speeds, turning_driver
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped
from mmpf.numerics.kernels import kernel
from mmpf.scan import BodyHeadings

GATE, LANE, NEXT, HEADING = -4, -3, -2, -1
"""Rows of the latents, from the end: a number from 0 to 1, below a link's probability of being open where the particle
takes it for open; index of the lane, index of the lane that follows, direction in the plane.
"""
GUIDANCE_SIZE = 4

# A driver makes up its mind anew, on average after this time, until it is in the junction.
CHANGE_OF_MIND_S = 2.0
# What it takes a link for, open or closed, it thinks over after this time on average.
GATE_S = 5.0
# Drivers exceed speed limits by this factor at most, and brake for a slower lane by this much.
ABOVE_LIMIT, BRAKING_MPS2 = 1.3, 3.0
# Nobody makes up its mind to a way that it would have to brake harder for than this.
HARD_BRAKING_MPS2 = 3.5
# Who is this far outside of its lane has lost it; another is taken whose direction differs by less than this.
LOST_M, ASTRAY_RAD = 1.5, np.deg2rad(60.0)
LOOKS_AROUND, LOOK_S = 0.2, 0.1
"""Share of vehicles astray that look for a lane within so long a time; looking costs."""
# How near to a lane's middle a vehicle was born that belongs to it.
BESIDE_STD_M = 1.0
# A map can be wrong. This is the weight of no lane against that of a lane whose middle the vehicle is on. At this rate
# particles of a vehicle in sight leave their lane, so that its detections can overrule the map.
ON_NO_LANE, LEAVES_PER_S = 0.01, 0.02
# Slower than this a vehicle hardly turns, and its lateral speed says nothing of its direction.
SLOWEST_TURN_MPS = 1.0
TIGHTEST_CURVATURE_PER_M = 0.2
MOST_TURN_RAD = 1.0
# Where no lanes hold vehicles they turn: lateral accelerations of 0.7 m/s² (root mean square) that last for 1.5 s are
# like white noise of sqrt(2 * 0.7² * 1.5) m/s per root second on the lateral speed.
TURNING_STD = 1.2


def guidance(latents: FloatArray) -> tuple[IntArray, IntArray]:
    """Return each particle's lane and the lane that it means to take next, each (n,); ``NOWHERE`` for none."""
    return latents[LANE].astype(np.int64), latents[NEXT].astype(np.int64)


@dataclass(frozen=True)
class AroundOnGraph(Surroundings):
    """What each of n particles knows of road and traffic, in its own lane's frame, and where it is there.

    Attributes:
        along_m: Arc length along its lane, nan off every lane, shape (n,).
        left_m: Offset to the left of the lane's middle, shape (n,).
    """

    along_m: FloatArray
    left_m: FloatArray


@dataclass(frozen=True)
class LaneFollowing(AroundAnother):
    """A motion model on a lane graph; see ``mmpf.motion.protocol.MotionModel``.

    Positions of the state are x and y; speeds and accelerations are along and across the particle's own lane.

    Attributes:
        inner: How a vehicle moves within its lane.
        graph: The lanes.
        drift_std: How far what stands drifts with the ego's own place, metres per root second.
    """

    own_rows: ClassVar[int] = GUIDANCE_SIZE
    graph: LaneGraph
    drift_std: float = 0.0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw the inner model's latents, and for each particle one of the lanes beside it, near ones rather than far.

        Off every lane the direction is anybody's guess.
        """
        latents = np.empty((self.latent_size, state.shape[1]))
        latents[:-GUIDANCE_SIZE] = self.inner.draw_latents(state, rng)
        lane, heading = self._draw_lanes(state[LON], state[LAT], np.full(state.shape[1], np.nan), rng)
        latents[LANE], latents[HEADING] = lane, heading
        graph, (choice, latents[GATE]) = self.graph, rng.uniform(size=(2, len(lane)))
        latents[NEXT] = _pick_successors(lane, choice, graph.successor, graph.first_successor)
        return latents

    def towards(self, latents: FloatArray, headings: BodyHeadings, rng: np.random.Generator) -> FloatArray:
        """Take particles off lanes that lead another way than was measured, and let those off lanes point as measured.

        See ``TakesHeadings.towards``.
        """
        pointing, after = drawn_directions(latents[HEADING], headings, rng), latents.copy()
        free = (latents[LANE] == NOWHERE) | (np.abs(wrapped(latents[HEADING] - pointing)) > ASTRAY_RAD)
        after[LANE, free] = after[NEXT, free] = NOWHERE
        after[HEADING, free] = pointing[free]
        return after

    propagate = propagate_by_rewriting

    def rewrite(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> FloatArray:
        """Take the particles to their lanes' frames, let the inner model move them there, and bring them back."""
        graph = self.graph
        lane, following = guidance(latents)
        if isinstance(surroundings, AroundOnGraph):
            along, left = surroundings.along_m, surroundings.left_m
        else:
            along, left, _ = graph.on_lane(lane, state[LON], state[LAT])
        leaves = ~surroundings.is_hidden & (rng.random(len(lane), dtype=np.float32) < LEAVES_PER_S * dt_s)
        lane[leaves] = following[leaves] = NOWHERE
        free = lane == NOWHERE
        local = state.copy()
        # Off every lane a vehicle goes on as it points, from where it is.
        local[LON], local[LAT] = np.where(free, 0.0, along), np.where(free, 0.0, left)
        moved = step_in_place(self.inner, local, latents[:-GUIDANCE_SIZE], surroundings, dt_s, rng)
        moved[SPEED] = np.minimum(moved[SPEED], self._speed_allowed(lane, following, along))
        stands = drawn_standing(state[SPEED], dt_s, rng)
        hold_still(moved, local, stands)

        change, choice, rethink, gate = rng.uniform(size=(4, len(lane)))
        along, left = moved[LON].copy(), moved[LAT].copy()
        changes_mind = change < dt_s / CHANGE_OF_MIND_S
        who = np.flatnonzero(changes_mind)
        changes_mind[who] = self._can_take(lane[who], choice[who], along[who], moved[SPEED, who])
        _go_along(lane, following, along, left, changes_mind, choice, graph.columns)
        x, y, direction = graph.place(lane, along, left)
        heading = latents[HEADING]
        cosine, sine = np.cos(heading), np.sin(heading)
        moved[LON] = np.where(free, state[LON] + along * cosine - left * sine, x)
        moved[LAT] = np.where(free, state[LAT] + along * sine + left * cosine, y)
        hold_still(moved, state, stands)
        drift_in_place(moved, stands, self.drift_std * np.sqrt(dt_s), rng)
        # Off every lane a vehicle goes where it points, as in a plane without lanes.
        steered = np.sqrt(dt_s) * TURNING_STD * rng.standard_normal(len(lane))
        turn = turn_of(moved[SPEED], moved[LAT_SPEED] + steered, dt_s)
        direction = np.where(free, wrapped(heading + turn), direction)
        moved[LAT_SPEED, free] = 0.0
        beyond = (along < -LOST_M) | (along > graph.length_m[lane] + LOST_M)
        astray = free | beyond | (np.abs(left) > 0.5 * graph.width_m[lane] + LOST_M)
        self._find_way_back(moved, np.flatnonzero(astray), lane, following, direction, dt_s, rng)
        gate = np.where(rethink < dt_s / GATE_S, gate, latents[GATE])
        latents[-GUIDANCE_SIZE:] = gate, lane, following, direction
        return moved

    def _speed_allowed(self, lane: IntArray, following: IntArray, along: FloatArray) -> FloatArray:
        """Return how fast one may go, so as to have slowed down to the next lane's limit at its beginning, (n,)."""
        limit, free = ABOVE_LIMIT * self.graph.speed_limit_mps, lane == NOWHERE
        left_m = np.maximum(self.graph.length_m[lane] - along, 0.0)
        ahead = np.where(following == NOWHERE, np.inf, limit[following])
        allowed = np.minimum(limit[lane], np.sqrt(ahead**2 + 2.0 * BRAKING_MPS2 * left_m))
        return np.where(free, np.inf, allowed)

    def _can_take(self, lane: IntArray, choice: FloatArray, along: FloatArray, speed: FloatArray) -> BoolArray:
        """Return whether vehicles can still slow down for the way that they would choose now, (n,)."""
        graph = self.graph
        chosen = _pick_successors(lane, choice, graph.successor, graph.first_successor)
        left_m = np.maximum(graph.length_m[lane] - along, 0.0)
        driven = lane_speeds(graph, turning_driver())[chosen]
        return np.asarray((chosen == NOWHERE) | (speed**2 <= driven**2 + 2.0 * HARD_BRAKING_MPS2 * left_m))

    def _find_way_back(
        self,
        state: FloatArray,
        astray: IntArray,
        lane: IntArray,
        following: IntArray,
        direction: FloatArray,
        dt_s: float,
        rng: np.random.Generator,
    ) -> None:
        """Look for a lane for those that are on none or far beside theirs; all is changed in place."""
        share = 1.0 - (1.0 - LOOKS_AROUND) ** (dt_s / LOOK_S)
        index = astray[rng.uniform(size=len(astray)) < share]
        if len(index) == 0:
            return
        lane[index], direction[index] = self._draw_lanes(state[LON, index], state[LAT, index], direction[index], rng)
        choice, graph = rng.uniform(size=len(index)), self.graph
        following[index] = _pick_successors(lane[index], choice, graph.successor, graph.first_successor)

    def _draw_lanes(
        self, x: FloatArray, y: FloatArray, heading: FloatArray, rng: np.random.Generator
    ) -> tuple[IntArray, FloatArray]:
        """Draw a lane or none beside each place that leads a vehicle's way (any way if nan), and the direction."""
        near = self.graph.lanes_near(x, y)
        weight = np.where(near.lane >= 0, np.exp(-0.5 * (near.left_m / BESIDE_STD_M) ** 2), 0.0)
        off = np.abs(wrapped(near.heading_rad - heading[:, None]))
        weight[off > ASTRAY_RAD] = 0.0
        share = np.cumsum(weight, axis=1)
        drawn = (rng.uniform(size=len(x))[:, None] * (share[:, -1:] + ON_NO_LANE) >= share).sum(axis=1)
        rows, found = np.arange(len(x)), drawn < near.lane.shape[1]
        drawn = np.where(found, drawn, 0)
        anywhere = np.where(np.isnan(heading), rng.uniform(-np.pi, np.pi, len(x)), heading)
        lane = np.where(found, near.lane[rows, drawn], NOWHERE)
        return lane, np.where(found, near.heading_rad[rows, drawn], anywhere)


def turn_of(speed_mps: FloatArray, lat_speed_mps: FloatArray, dt_s: float) -> FloatArray:
    """Return by how much vehicles turn that drift, no more than their tightest bend lets them in a step, shape (n,)."""
    most = np.minimum(TIGHTEST_CURVATURE_PER_M * speed_mps * dt_s, MOST_TURN_RAD)
    return np.asarray(np.clip(np.arctan2(lat_speed_mps, np.maximum(speed_mps, SLOWEST_TURN_MPS)), -most, most))


@kernel()
def _pick(lane: int, choice: float, successor: IntArray, first_successor: IntArray) -> int:
    count = first_successor[lane + 1] - first_successor[lane]
    return successor[first_successor[lane] + min(int(choice * count), count - 1)] if count > 0 else NOWHERE


@kernel()
def _pick_successors(lane: IntArray, choice: FloatArray, successor: IntArray, first_successor: IntArray) -> IntArray:
    picked = np.full(len(lane), NOWHERE)
    for n in range(len(lane)):
        if lane[n] >= 0:
            picked[n] = _pick(lane[n], choice[n], successor, first_successor)
    return picked


@kernel()
def _go_along(
    lane: IntArray,
    following: IntArray,
    along: FloatArray,
    left: FloatArray,
    changes_mind: BoolArray,
    choice: FloatArray,
    lanes: LaneColumns,
) -> None:
    """Take particles over their lanes' edges and ends, in place; who changes its mind chooses its next lane anew."""
    length, width, left_of, right_of, successor, first_successor, _, in_junction = lanes
    for n in range(len(lane)):
        if lane[n] < 0:
            continue
        own, u = lane[n], choice[n]
        beside = left_of[own] if left[n] > 0.5 * width[own] else (right_of[own] if left[n] < -0.5 * width[own] else -1)
        if beside >= 0:
            apart = 0.5 * (width[own] + width[beside])
            left[n] += -apart if left[n] > 0.0 else apart
            along[n] *= length[beside] / length[own]
            own = beside
            following[n] = _pick(own, u, successor, first_successor)
        elif changes_mind[n] and not in_junction[own]:
            following[n] = _pick(own, u, successor, first_successor)
        while along[n] >= length[own] and following[n] >= 0:
            along[n] -= length[own]
            own = following[n]
            u = (u * 7919.0) % 1.0
            following[n] = _pick(own, u, successor, first_successor)
        lane[n] = own
