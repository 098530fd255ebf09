"""Windows of a recording around a lane change: five seconds before and after, as in the paper."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.lab.windows.neighbours import NeighbourStates, lane_lines, nearest_row, others_at
from harness.lab.windows.recording import Recording, joined_apart, load_all
from harness.truth.frame import STEP_S
from mmpf.map.road import NO_LANE, Road
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import FloatArray, IntArray

HALF_WINDOW_S = 5.0


@dataclass(frozen=True)
class LaneChanges:
    """Windows around lane changes, lateral from the original lane's middle and positive towards the target lane.

    Attributes:
        states: States as in ``mmpf.motion.state``, shape (windows, 6, steps).
        lane_width_m: Mean width of original and target lane, shape (windows,).
        traffic: A number that windows of the same recording share, shape (windows,).
    """

    states: FloatArray
    length_m: FloatArray
    lane_width_m: FloatArray
    leader: NeighbourStates
    follower: NeighbourStates
    target_leader: NeighbourStates
    traffic: IntArray

    def __len__(self) -> int:
        return len(self.length_m)

    @property
    def state(self) -> FloatArray:
        """The states, shape (6, windows, steps)."""
        return self.states.swapaxes(0, 1)


def lane_change_windows(recording: Recording, road: Road) -> LaneChanges:
    """Cut out every change between two neighbouring main lanes that is the only one within five seconds around it."""
    half = round(HALF_WINDOW_S / STEP_S)
    by_vehicle = np.lexsort((recording.step, recording.vehicle))
    rows = by_vehicle[_single_changes(recording, by_vehicle, half)[:, None] + np.arange(-half, half + 1)]
    original, target = recording.lane[rows[:, half - 1]], recording.lane[rows[:, half]]
    first_m, second_m = (lane_lines(road, lane).mean(axis=1) for lane in (original, target))
    known = np.isfinite(first_m) & np.isfinite(second_m)
    rows, original, target, first_m, second_m = (each[known] for each in (rows, original, target, first_m, second_m))
    direction = np.sign(second_m - first_m)
    step, lon = recording.step[rows], recording.lon_m[rows]
    on_original, on_target = original[:, None], target[:, None]
    state = np.empty((STATE_SIZE, *rows.shape))
    state[LON], state[SPEED], state[ACCEL] = lon, recording.speed_mps[rows], recording.accel_mps2[rows]
    state[LAT] = direction[:, None] * (recording.lat_m[rows] - first_m[:, None])
    state[LAT_SPEED] = direction[:, None] * recording.lat_speed_mps[rows]
    state[LAT_ACCEL] = np.diff(state[LAT_SPEED], axis=1, prepend=state[LAT_SPEED][:, :1]) / STEP_S
    return LaneChanges(
        states=state.swapaxes(0, 1),
        length_m=recording.length_m[rows[:, 0]],
        lane_width_m=np.abs(second_m - first_m),
        leader=others_at(recording, nearest_row(recording, step, on_original, lon, ahead=True)),
        follower=others_at(recording, nearest_row(recording, step, on_target, lon, ahead=False)),
        target_leader=others_at(recording, nearest_row(recording, step, on_target, lon, ahead=True)),
        traffic=np.zeros(len(rows), dtype=np.int64),
    )


def load_changes(paths: Sequence[Path], road: Road) -> LaneChanges:
    """Cut recordings that lie in files into windows around lane changes."""
    return joined_apart([lane_change_windows(recording, road) for recording in load_all(paths)], "traffic")


def changes_to_one_side_per_s(recordings: Iterable[Recording]) -> float:
    """Return how often a driver on a lane of the road changes to the one side, and as often to the other, a second."""
    changes, steps = 0, 0
    for recording in recordings:
        by_vehicle = np.lexsort((recording.step, recording.vehicle))
        lane, vehicle = recording.lane[by_vehicle], recording.vehicle[by_vehicle]
        driven_on = (vehicle[1:] == vehicle[:-1]) & (lane[1:] != NO_LANE) & (lane[:-1] != NO_LANE)
        changes += int((driven_on & (lane[1:] != lane[:-1])).sum())
        steps += int(driven_on.sum())
    return changes / (2.0 * steps * STEP_S) if steps else 0.0


def _single_changes(recording: Recording, by_vehicle: IntArray, half: int) -> IntArray:
    """Return places in the sorted rows where a lane differs from the step before, and none other does nearby."""
    lane, vehicle, step = (column[by_vehicle] for column in (recording.lane, recording.vehicle, recording.step))
    n = len(lane)
    changed = np.concatenate([[False], (lane[1:] != lane[:-1]) & (vehicle[1:] == vehicle[:-1])])
    place = np.flatnonzero(changed)
    place = place[(place >= half) & (place < n - half)]
    running = np.concatenate([[0], np.cumsum(changed)])
    alone = running[place + half + 1] - running[place - half + 1] == 1
    whole = (vehicle[place - half] == vehicle[place + half]) & (step[place + half] - step[place - half] == 2 * half)
    on_road = (lane[place] != NO_LANE) & (lane[place - 1] != NO_LANE)
    return np.asarray(place[alone & whole & on_road])
