"""Compiled loops over lane segments: the lane of each position, and positions along lanes."""

from typing import NamedTuple

import numpy as np

from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.numerics.kernels import kernel


class Segments(NamedTuple):
    """The straight pieces of all lanes' middle lines, those of a lane one after the other; arrays of shape (q,).

    Attributes:
        start_x: Where each begins, metres.
        start_y: The same.
        cosine: Its direction.
        sine: The same.
        length_m: Its length.
        along_m: Arc length from the lane's beginning to its own.
        lane: Index of its lane.
        first: Index of each lane's first piece, and the number of all, shape (l + 1,).
    """

    start_x: FloatArray
    start_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    length_m: FloatArray
    along_m: FloatArray
    lane: IntArray
    first: IntArray


class Cells(NamedTuple):
    """Which segments may be near which places: the plane in squares.

    Attributes:
        origin: Lower left corner of the first square, metres, shape (2,).
        size_m: Their side.
        shape: How many there are along x and along y.
        first: Where each square's list begins, shape (squares + 1,).
        segment: Segments of all lists.
    """

    origin: FloatArray
    size_m: float
    shape: tuple[int, int]
    first: IntArray
    segment: IntArray


class LanesNear(NamedTuple):
    """Up to k lanes beside each of n places, the nearest first; arrays of shape (n, k).

    Attributes:
        lane: Index of the lane, ``NOWHERE`` where there are fewer.
        along_m: Arc length along it.
        left_m: Offset to the left of its middle line.
        heading_rad: Its direction there.
    """

    lane: IntArray
    along_m: FloatArray
    left_m: FloatArray
    heading_rad: FloatArray


@kernel()
def fill_cells(first_cell: IntArray, last_cell: IntArray, shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Return which pieces lie in which squares: where each square's list begins, and the lists one after the other.

    Args:
        first_cell: Column and row of each piece's lowest square, shape (2, q).
        last_cell: Column and row of its highest, shape (2, q).
        shape: Columns and rows of the plane.

    Returns:
        Shapes (columns times rows + 1,) and (entries,).
    """
    count = np.zeros(shape[0] * shape[1] + 1, dtype=np.int64)
    for fill in range(2):
        if fill:
            begin = np.cumsum(count)
            segment = np.empty(begin[-1], dtype=np.int64)
            place = begin - count
        for q in range(first_cell.shape[1]):
            for column in range(first_cell[0, q], last_cell[0, q] + 1):
                for row in range(first_cell[1, q], last_cell[1, q] + 1):
                    cell = column * shape[1] + row
                    if fill:
                        segment[place[cell]] = q
                        place[cell] += 1
                    else:
                        count[cell] += 1
    return begin - count, segment


@kernel()
def find_lanes(
    x: FloatArray, y: FloatArray, cells: Cells, pieces: Segments, reach_m: FloatArray, near: LanesNear
) -> None:
    """Write up to k lanes beside each of n places, the nearest first; what there are fewer of stays as it is.

    Args:
        x: Places, metres, shape (n,).
        y: The same.
        cells: Which pieces may be near which places.
        pieces: The straight pieces of all lanes.
        reach_m: How far from its middle line a place is still beside a lane, shape (l,).
        near: Written to, shape (n, k).
    """
    start_x, start_y, cosine, sine, length, piece_along, piece_lane, _ = pieces
    origin, size_m, shape, first, members = cells
    lane, along, left, heading = near
    most = lane.shape[1]
    distance = np.empty(most)
    for n in range(len(x)):
        column, row = int(np.floor((x[n] - origin[0]) / size_m)), int(np.floor((y[n] - origin[1]) / size_m))
        if not (0 <= column < shape[0] and 0 <= row < shape[1]):
            continue
        cell, found = column * shape[1] + row, 0
        for place in range(first[cell], first[cell + 1]):
            q = members[place]
            away_x, away_y = x[n] - start_x[q], y[n] - start_y[q]
            t = min(max(away_x * cosine[q] + away_y * sine[q], 0.0), length[q])
            off_x, off_y = away_x - t * cosine[q], away_y - t * sine[q]
            away = np.sqrt(off_x * off_x + off_y * off_y)
            if away > reach_m[piece_lane[q]]:
                continue
            # One entry a lane: a nearer piece of a lane that is listed takes its place.
            at = found
            for k in range(found):
                if lane[n, k] == piece_lane[q]:
                    at = k
                    break
            if at < found:
                if away >= distance[at]:
                    continue
            elif found < most:
                found += 1
            else:
                at = most - 1
                if away >= distance[at]:
                    continue
            while at > 0 and distance[at - 1] > away:
                lane[n, at], along[n, at], left[n, at] = lane[n, at - 1], along[n, at - 1], left[n, at - 1]
                heading[n, at], distance[at] = heading[n, at - 1], distance[at - 1]
                at -= 1
            lane[n, at], along[n, at], distance[at] = piece_lane[q], piece_along[q] + t, away
            left[n, at] = away if off_y * cosine[q] - off_x * sine[q] >= 0.0 else -away
            heading[n, at] = np.arctan2(sine[q], cosine[q])


@kernel()
def project(
    lane: IntArray,
    x: FloatArray,
    y: FloatArray,
    pieces: Segments,
    along: FloatArray,
    left: FloatArray,
    heading: FloatArray,
) -> None:
    """Write arc length, offset to the left and lane's direction of places on given lanes, each (n,).

    Args:
        lane: Lane of each place, negative for none, whose place stays as it is, shape (n,).
        x: Places, metres, shape (n,).
        y: The same.
        pieces: The straight pieces of all lanes; the first and last of a lane go on beyond its ends.
        along: Written to, as the rest.
        left: Offset to the left.
        heading: Direction of the lane.
    """
    start_x, start_y, cosine, sine, length, piece_along, _, first = pieces
    for n in range(len(x)):
        if lane[n] < 0:
            continue
        nearest = np.inf
        begin, end = first[lane[n]], first[lane[n] + 1]
        for q in range(begin, end):
            away_x, away_y = x[n] - start_x[q], y[n] - start_y[q]
            t = away_x * cosine[q] + away_y * sine[q]
            if q > begin:
                t = max(t, 0.0)
            if q < end - 1:
                t = min(t, length[q])
            off_x, off_y = away_x - t * cosine[q], away_y - t * sine[q]
            away = off_x * off_x + off_y * off_y
            if away < nearest:
                nearest = away
                along[n] = piece_along[q] + t
                left[n] = np.sqrt(away) if off_y * cosine[q] - off_x * sine[q] >= 0.0 else -np.sqrt(away)
                heading[n] = np.arctan2(sine[q], cosine[q])


@kernel()
def lay_out(
    lane: IntArray,
    along: FloatArray,
    left: FloatArray,
    pieces: Segments,
    x: FloatArray,
    y: FloatArray,
    heading: FloatArray,
) -> None:
    """Write x, y and direction of places on lanes, each (n,): the inverse of ``project``, whose arguments these are."""
    start_x, start_y, cosine, sine, _, piece_along, _, first = pieces
    for n in range(len(along)):
        if lane[n] < 0:
            continue
        q = first[lane[n]]
        while q + 1 < first[lane[n] + 1] and along[n] >= piece_along[q + 1]:
            q += 1
        t = along[n] - piece_along[q]
        x[n] = start_x[q] + t * cosine[q] - left[n] * sine[q]
        y[n] = start_y[q] + t * sine[q] + left[n] * cosine[q]
        heading[n] = np.arctan2(sine[q], cosine[q])
