"""A recorded drive: labels, a real detector's boxes, and the poses of the recording car."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, TypeVar

import numpy as np

from mmpf.map.lane_graph import LaneGraph
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, StringArray, taken

EGO = "ego"


@dataclass(frozen=True)
class RecordedBoxes:
    """Boxes in the plane by their middles, struct of arrays of shape (n,); the heading is that of the front."""

    step: IntArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    length_m: FloatArray
    width_m: FloatArray

    def __len__(self) -> int:
        return len(self.step)

    @property
    def columns(self) -> dict[str, Any]:
        """Its columns by name."""
        return {column.name: getattr(self, column.name) for column in fields(self)}

    def take(self, rows: IntArray | BoolArray) -> Self:
        """Return the chosen rows."""
        return taken(self, rows)


B = TypeVar("B", bound=RecordedBoxes)


@dataclass(frozen=True)
class Labels(RecordedBoxes):
    """Human-labelled boxes, also of hidden objects; shape (n,).

    Attributes:
        counts: Whether it is a vehicle that trackers are judged on; others only hide.
        covered: Whether whoever labelled it says that it is partly or largely covered, or cut off by the picture.
        vehicle_class: Code of its class; None if nobody tells.
    """

    thing: IntArray
    counts: BoolArray
    covered: BoolArray
    vehicle_class: IntArray | None = None


@dataclass(frozen=True)
class GivenBoxes(RecordedBoxes):
    """Boxes that a detector found, shape (d,); the larger the ``score``, the surer it was; classes may be unknown."""

    score: FloatArray
    vehicle_class: IntArray | None = None


@dataclass(frozen=True)
class EgoPoses:
    """Where the recording car's sensor was at each step, in the plane; arrays of shape (steps,)."""

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray

    def __len__(self) -> int:
        return len(self.x_m)


@dataclass(frozen=True)
class Drive:
    """A drive in the plane, ten steps a second.

    Attributes:
        drawn: Whether the detections are labels of what was seen, whose errors are to be drawn.
    """

    name: str
    ego: EgoPoses
    names: StringArray
    labels: Labels
    given: GivenBoxes
    left_out: Mapping[str, int] = field(default_factory=dict)
    drawn: bool = False
    lanes: LaneGraph | None = None

    def cut(self, first: int, steps: int) -> Drive:
        """Return the drive from a step on, at most so many of them, counted from 0 again."""
        last = min(first + steps, len(self.ego))
        path = taken(self.ego, np.arange(first, last))
        return replace(self, ego=path, labels=_cut(self.labels, first, last), given=_cut(self.given, first, last))

    def scored_above(self, least_score: float) -> Drive:
        """Return the drive without the detections of a lower score."""
        return replace(self, given=self.given.take(self.given.score >= least_score))

    def moved(self, x_m: float) -> Drive:
        """Return the drive in a plane whose origin lies so far back along x."""
        lanes = self.lanes and replace(self.lanes, xy=self.lanes.xy + np.array([x_m, 0.0]))
        ego = replace(self.ego, x_m=self.ego.x_m + x_m)
        return replace(self, ego=ego, labels=_moved(self.labels, x_m), given=_moved(self.given, x_m), lanes=lanes)


def _cut(boxes: B, first: int, last: int) -> B:
    inside = boxes.take((boxes.step >= first) & (boxes.step < last))
    return replace(inside, step=inside.step - first)


def _moved(boxes: B, x_m: float) -> B:
    return replace(boxes, x_m=boxes.x_m + x_m)


def sorted_by_step(boxes: B) -> B:
    """Return boxes sorted by step, those of one step in the order they were in."""
    return boxes.take(np.argsort(boxes.step, kind="stable"))


def step_starts(step: IntArray, steps: int) -> IntArray:
    """Return where each step's rows begin among sorted ones, and the end of the last, shape (steps + 1,)."""
    return np.asarray(np.searchsorted(step, np.arange(steps + 1)), dtype=np.int64)
