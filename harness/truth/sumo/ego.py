"""The ego vehicle: chosen near the section's start, replaced when it leaves the section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from harness.truth.frame import Frame
from mmpf.compute.arrays import FloatArray, IntArray
from mmpf.road import NO_LANE

NO_EGO = ""
NO_EGO_INDEX = -1
START_WINDOW_M = 60.0
CAR_LENGTH_M = (3.0, 6.5)


@dataclass(frozen=True)
class EgoChoice:
    """Which vehicle is the ego.

    Attributes:
        vehicle_id: Its name; empty if there is none.
        episode: Number of its stay, from 0.
    """

    vehicle_id: str
    episode: int

    def apply(self, frame: Frame) -> Frame:
        """Return the frame with this ego and episode."""
        index = int(np.flatnonzero(frame.vehicle_id == self.vehicle_id)[0])
        return replace(frame, ego=index, episode=self.episode)


def choose_ego(frame: Frame, present: EgoChoice, ego_lanes: Sequence[int], section_m: tuple[float, float]) -> EgoChoice:
    """Keep the present ego while it is on the section's lanes, else choose another and begin a new episode.

    A car on one of ``ego_lanes`` within 60 m of the section's start comes first; failing that the best there is. Empty
    ``vehicle_id`` if no vehicle is on the section.
    """
    inside = (frame.lon_m >= section_m[0]) & (frame.lon_m < section_m[1]) & (frame.lane != NO_LANE)
    if np.any(inside & (frame.vehicle_id == present.vehicle_id)):
        return present
    candidates = np.flatnonzero(inside)
    if len(candidates) == 0:
        return EgoChoice(vehicle_id=NO_EGO, episode=present.episode + 1)
    best = candidates[np.lexsort(_worse_first_keys(frame, candidates, ego_lanes, section_m[0]))[0]]
    return EgoChoice(vehicle_id=str(frame.vehicle_id[best]), episode=present.episode + 1)


def _worse_first_keys(
    frame: Frame, candidates: IntArray, ego_lanes: Sequence[int], start_m: float
) -> tuple[FloatArray | npt.NDArray[np.bool_], ...]:
    """Return sort keys, the last the most important, as ``numpy.lexsort`` takes them."""
    lon = frame.lon_m[candidates] - start_m
    length = frame.length_m[candidates]
    no_car = (length < CAR_LENGTH_M[0]) | (length > CAR_LENGTH_M[1])
    beyond_window_m = np.maximum(0.0, lon - START_WINDOW_M)
    wrong_lane = ~np.isin(frame.lane[candidates], np.asarray(ego_lanes))
    return lon, beyond_window_m, no_car, wrong_lane
