"""Asks the ego's driver at each step for a command by the truth and one by the tracks."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from harness.decisions.bodies import Bodies, Egos
from harness.decisions.decide import Decision, decide
from harness.decisions.drivers.protocol import Driver
from harness.scoring.driving.believed import egos_of, tracked_bodies, true_bodies
from harness.scoring.evidence.history import first_of_group, last_row_where
from harness.scoring.evidence.plain_view import durations
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import DRIVER_EXISTENCE, TIME_TOLERANCE_S
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

SETTLED_S = 2.0
"""Time from the beginning of an ego's stay until its driver's decisions are judged."""


@dataclass(frozen=True)
class DriverSetup:
    """Who is asked, and on which road."""

    driver: Driver
    road: Road


@dataclass(frozen=True)
class Asked:
    """What the driver would do at each step by the truth and by the tracks.

    Attributes:
        there: Steps at which there is an ego, shape (steps,).
        bodies: The true vehicles, in the order of ``TruthRows``.
        truth: Its decision by the truth; bodies are rows of ``TruthRows``.
        tracks: Its decision by the tracks; bodies are places in ``track_row``.
        track_row: Row of ``TrackRows`` of each body that the tracks amount to, doubtful ones left out.
        judged: Steps at which the two are held together, shape (steps,).
        driven_m: How far the ego drives in each step, 0 where it is not judged, shape (steps,).
        step_s: Time that each step stands for, shape (steps,).
    """

    driver: Driver
    egos: Egos
    there: BoolArray
    bodies: Bodies
    truth: Decision
    tracks: Decision
    track_row: IntArray
    judged: BoolArray
    driven_m: FloatArray
    step_s: FloatArray


def ask(driven: DriverSetup, truth: pd.DataFrame, detections: pd.DataFrame, rows: RunRows) -> Asked:
    """Ask the driver, with a run's tables and its rows.

    A track counts as a vehicle from an existence of one half on; for one with less the driver slows down gently. The
    first seconds of each ego are not judged: no tracker can know the traffic yet.
    """
    egos, there = egos_of(truth, rows)
    bodies = tracked_bodies(detections, rows, egos, driven.road)
    doubtful = rows.tracks.existence < DRIVER_EXISTENCE
    step_s, since_s = _times(rows)
    judged = there & (since_s >= SETTLED_S - TIME_TOLERANCE_S)
    real, believed = true_bodies(truth, rows), replace(bodies, doubtful=doubtful)
    return Asked(
        driver=driven.driver,
        egos=egos,
        there=there,
        bodies=real,
        truth=decide(driven.driver, real, egos, driven.road),
        tracks=decide(driven.driver, believed, egos, driven.road),
        track_row=np.flatnonzero(~doubtful),
        judged=judged,
        driven_m=np.where(judged, egos.speed_mps * step_s, 0.0),
        step_s=step_s,
    )


def _times(rows: RunRows) -> tuple[FloatArray, FloatArray]:
    """Return the time that each step stands for and the time since its episode began, both of shape (steps,)."""
    begins = last_row_where(first_of_group(rows.episode), rows.episode)
    return durations(rows.time_s, rows.episode), rows.time_s - rows.time_s[begins]
