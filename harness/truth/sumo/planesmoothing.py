"""Smooths SUMO's motion in the plane, over half a second to either side, with speeds that are its positions' change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.truth.frame import Frame
from harness.truth.sumo.planereading import Snapshot
from harness.truth.sumo.smoothing import DECIMALS, hann_weights, lead_frames
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.numerics.arrays import FloatArray, IntArray

NO_EGO_INDEX = -1


def lead_snapshots(step_s: float) -> int:
    """Return how many snapshots before and after a frame it is made of: one more than averaged, for the speeds."""
    return lead_frames(step_s) + 1


def smoothed_frame(
    window: Sequence[Snapshot],
    names: Sequence[str],
    graph: LaneGraph,
    step: int,
    step_s: float,
    *,
    knows_persons: bool = False,
) -> Frame:
    """Return some vehicles of the window's middle snapshot, smoothed; the frame has no ego yet.

    Before a vehicle has come and after it has left it is taken to go on evenly, so that none is left out.

    Args:
        window: Snapshots, ``lead_snapshots`` before and as many after the middle one.
        names: Which vehicles, all of them in the middle snapshot.
        graph: The lanes.
        step: Number of the frame.
        step_s: Time between snapshots.
        knows_persons: Whether the frame tells who is on foot.
    """
    reach = len(window) // 2
    middle = window[reach]
    rows = np.array([middle.row[name] for name in names], dtype=np.int64)
    place, direction = _tracks(window, names)
    weights = hann_weights(reach - 1)
    before, now, after = (np.tensordot(weights, place[k : k + len(weights)], axes=1).reshape(-1, 2) for k in range(3))
    turn = np.tensordot(weights, direction[1:-1], axes=1).reshape(-1, 2)
    heading = np.arctan2(turn[:, 1], turn[:, 0])
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    velocity, change = (after - before) / (2.0 * step_s), (after - 2.0 * now + before) / step_s**2
    # A body that SUMO shifts sideways may point a little against its motion, but nobody drives backwards.
    speed = np.maximum((velocity * ahead).sum(axis=1), 0.0)

    def rounded(values: FloatArray) -> FloatArray:
        # Adding zero turns -0.0 into 0.0.
        return np.asarray(np.round(values, DECIMALS) + 0.0)

    return Frame(
        step=step,
        time_s=round(step * step_s, 6),
        episode=0,
        ego=NO_EGO_INDEX,
        vehicle_id=np.array(names, dtype=np.str_),
        lon_m=rounded(now[:, 0]),
        lat_m=rounded(now[:, 1]),
        heading_rad=rounded(heading),
        speed_mps=rounded(speed),
        lat_speed_mps=rounded(ahead[:, 0] * velocity[:, 1] - ahead[:, 1] * velocity[:, 0]),
        accel_mps2=rounded((change * ahead).sum(axis=1)),
        lane=1 + lanes_of([middle.lanes[row] for row in rows], graph, now),
        length_m=rounded(np.array([middle.body[row].length_m for row in rows])),
        width_m=rounded(np.array([middle.body[row].width_m for row in rows])),
        direction_rad=rounded(heading),
        pedestrian=np.array([middle.body[row].is_pedestrian for row in rows], dtype=np.bool_)
        if knows_persons
        else None,
        signals=middle.signals,
    )


def lanes_of(lanes: Sequence[tuple[int, ...]], graph: LaneGraph, place: FloatArray) -> IntArray:
    """Return the lane that each vehicle's middle is on, (n,): the last one that it has entered with more than its nose.

    Args:
        lanes: The lanes that each one's front was on, the present one first, ``NOWHERE`` off the graph.
        graph: The lanes.
        place: The middles, metres, shape (n, 2).
    """
    found = np.array([entered[0] for entered in lanes], dtype=np.int64)
    settled = found == NOWHERE
    for k in range(max(map(len, lanes), default=0)):
        lane = np.array([entered[k] if k < len(entered) else NOWHERE for entered in lanes], dtype=np.int64)
        along = graph.on_lane(lane, place[:, 0], place[:, 1])[0]
        known = ~settled & (lane != NOWHERE)
        found[known] = lane[known]
        settled |= known & (along >= 0.0)
    return found


def _tracks(window: Sequence[Snapshot], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return middles and directions (cosine, sine) of vehicles over the window, each of shape (w, n, 2)."""
    place = np.full((len(window), len(names), 2), np.nan)
    direction = place.copy()
    for k, snapshot in enumerate(window):
        rows = np.array([snapshot.row.get(name, -1) for name in names], dtype=np.int64)
        there = rows >= 0
        place[k, there] = snapshot.centres()[rows[there]]
        heading = snapshot.heading_rad[rows[there]]
        direction[k, there] = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    for n in np.flatnonzero(np.isnan(place[:, :, 0]).any(axis=0)):
        _go_on_evenly(place[:, n], direction[:, n])
    return place, direction


def _go_on_evenly(place: FloatArray, direction: FloatArray) -> None:
    """Fill in, in place, where a vehicle would be that is not in all snapshots: of its stay in the middle one alone."""
    there = ~np.isnan(place[:, 0])
    middle = len(place) // 2
    first = middle - int(np.argmin(np.append(there[middle::-1], False))) + 1
    last = middle + int(np.argmin(np.append(there[middle:], False))) - 1
    stays = last > first
    step_in = place[first + 1] - place[first] if stays else np.zeros(2)
    step_out = place[last] - place[last - 1] if stays else np.zeros(2)
    for k in range(first - 1, -1, -1):
        place[k], direction[k] = place[k + 1] - step_in, direction[first]
    for k in range(last + 1, len(place)):
        place[k], direction[k] = place[k - 1] + step_out, direction[last]
