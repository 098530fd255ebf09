"""What a detector on record found of each labelled vehicle, and what it found that nobody labelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.sensor.visibility import visible_fractions
from harness.truth.recorded.detected.drive import Drive, step_starts
from harness.truth.recorded.detected.origin import NOTHING, origins, pairs_within
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, turned

EGO_LENGTH_M, EGO_WIDTH_M = 4.5, 1.8
# A false box belongs to a false object whose last one was at most so long ago and so near.
LINKED_STEPS, LINKED_M = 5, 2.5


@dataclass(frozen=True)
class Looks:
    """Labels of vehicles and what was found of them, struct of arrays of shape (n,), by vehicle and then by step.

    Attributes:
        vehicle: Number of the vehicle, whose labels go on from step to step; where they don't, another begins.
        step: Step of its drive.
        distance_m: From the sensor.
        fraction: How much of it the other labels leave visible, seen from above.
        found: Whether a detection is of it.
        along_m: Error of the detection along its box; nan where there is none.
        across_m: Error across it.
        longer_m: Error of the length.
        wider_m: Error of the width.
    """

    vehicle: IntArray
    step: IntArray
    distance_m: FloatArray
    fraction: FloatArray
    found: BoolArray
    along_m: FloatArray
    across_m: FloatArray
    longer_m: FloatArray
    wider_m: FloatArray

    def __len__(self) -> int:
        return len(self.step)


def looks_of(drives: Sequence[Drive], range_m: float) -> Looks:
    """Return what was found of all vehicles of some drives that are within range."""
    looks, first = None, 0
    for drive in drives:
        some = _looks_of(drive, range_m, first)
        first = int(some.vehicle.max()) + 1 if len(some) else first
        looks = some if looks is None else joined(looks, some)
    if looks is None:
        raise ValueError("no drives")
    return looks


def _looks_of(drive: Drive, range_m: float, first: int) -> Looks:
    labels, given, ego = drive.labels, drive.given, drive.ego
    origin = origins(drive)
    at = np.full(len(labels), NOTHING)
    at[origin[origin != NOTHING]] = np.flatnonzero(origin != NOTHING)
    found = at != NOTHING
    distance = np.hypot(labels.x_m - ego.x_m[labels.step], labels.y_m - ego.y_m[labels.step])
    errors = np.full((4, len(labels)), np.nan)
    box = given.take(at[found])
    own = labels.take(found)
    errors[:2, found] = turned(box.x_m - own.x_m, box.y_m - own.y_m, own.heading_rad)
    errors[2:, found] = box.length_m - own.length_m, box.width_m - own.width_m
    order = np.lexsort((labels.step, labels.thing))
    order = order[(labels.counts & (distance <= range_m))[order]]
    thing, step = labels.thing[order], labels.step[order]
    begins = (np.diff(thing, prepend=-1) != 0) | (np.diff(step, prepend=-2) != 1)
    return Looks(
        first + np.cumsum(begins) - 1,
        step,
        distance[order],
        fractions_of(drive)[order],
        found[order],
        *(error[order] for error in errors),
    )


def fractions_of(drive: Drive) -> FloatArray:
    """Return how much of each labelled box the others leave visible, seen from above, shape (n,)."""
    labels, ego = drive.labels, drive.ego
    starts = step_starts(labels.step, len(ego))
    fraction = np.ones(len(labels))
    for step in range(len(ego)):
        rows = slice(int(starts[step]), int(starts[step + 1]))
        columns = (labels.x_m, labels.y_m, labels.heading_rad, labels.length_m, labels.width_m)
        place = np.array([ego.x_m[step], ego.y_m[step]])
        # A label on the recording car itself would hide all others.
        near = np.hypot(labels.x_m[rows] - place[0], labels.y_m[rows] - place[1]) < 0.5 * EGO_LENGTH_M
        chosen = np.arange(rows.start, rows.stop)[~near]
        fraction[chosen] = visible_fractions(place, *(column[chosen] for column in columns))[0]
    return fraction


def gap_steps(looks: Looks, found: BoolArray) -> IntArray:
    """Return the lengths of runs of misses between two detections of a vehicle, steps, shape (g,).

    Args:
        looks: The labels.
        found: Which of them were found, shape (n,).
    """
    hit = np.flatnonzero(found)
    same = looks.vehicle[hit[1:]] == looks.vehicle[hit[:-1]]
    missed = np.diff(hit)[same] - 1
    return np.asarray(missed[missed > 0])


@dataclass(frozen=True)
class FalseObjects:
    """False boxes in chains, each of one false object; struct of arrays of shape (c,).

    Attributes:
        life_steps: From the first box to the last, both counted.
        boxes: How many there are.
    """

    life_steps: IntArray
    boxes: IntArray


def false_objects_of(drives: Sequence[Drive]) -> FalseObjects:
    """Return the chains of false boxes of some drives."""
    chains = [chain for drive in drives for chain in _chains_of(drive)]
    first, last, boxes = np.array(chains, dtype=np.int64).reshape(-1, 3).T
    return FalseObjects(last - first + 1, boxes)


def _chains_of(drive: Drive) -> list[tuple[int, int, int]]:
    """Return first step, last step and number of boxes of each chain of false boxes."""
    given = drive.given.take(origins(drive) == NOTHING)
    starts = step_starts(given.step, len(drive.ego))
    open_chains: list[_Chain] = []
    done: list[_Chain] = []
    for step in range(len(drive.ego)):
        rows = slice(int(starts[step]), int(starts[step + 1]))
        places = np.stack([given.x_m[rows], given.y_m[rows]], axis=-1)
        done += [chain for chain in open_chains if step - chain.last > LINKED_STEPS]
        open_chains = [chain for chain in open_chains if step - chain.last <= LINKED_STEPS]
        expected = np.array([chain.expected(step) for chain in open_chains]).reshape(-1, 2)
        away = np.hypot(*(expected[:, None] - places).transpose(2, 0, 1))
        own, other = pairs_within(away, LINKED_M) if away.size else (np.zeros(0, int), np.zeros(0, int))
        for k, j in zip(own.tolist(), other.tolist(), strict=True):
            open_chains[k].add(step, places[j])
        new = np.setdiff1d(np.arange(len(places)), other)
        open_chains += [_Chain(step, step, 1, places[j], np.zeros(2)) for j in new.tolist()]
    return [(chain.first, chain.last, chain.boxes) for chain in (*done, *open_chains)]


@dataclass
class _Chain:
    """A chain of false boxes: its steps, how many, the last one's place and how far it goes a step."""

    first: int
    last: int
    boxes: int
    place: FloatArray
    pace: FloatArray

    def expected(self, step: int) -> FloatArray:
        return np.asarray(self.place + self.pace * (step - self.last))

    def add(self, step: int, place: FloatArray) -> None:
        pace = (place - self.place) / (step - self.last)
        self.pace = pace if self.boxes == 1 else 0.5 * (self.pace + pace)
        self.last, self.boxes, self.place = step, self.boxes + 1, place


def seen_at_all(drive: Drive) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the distance and visible fraction of each label of a vehicle, and whether it was found, each (n,)."""
    labels, ego = drive.labels, drive.ego
    found = np.zeros(len(labels), dtype=np.bool_)
    origin = origins(drive)
    found[origin[origin != NOTHING]] = True
    distance = np.hypot(labels.x_m - ego.x_m[labels.step], labels.y_m - ego.y_m[labels.step])
    chosen = labels.counts
    return distance[chosen], fractions_of(drive)[chosen], found[chosen]
