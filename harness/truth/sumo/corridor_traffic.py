"""Traffic along one main road: warm-up, smoothing, and the view from an ego on its section.

All of a vehicle's quantities are averaged with the same weights. The average is linear, so positions remain the
integral of the speeds, speeds that of the accelerations, and a gap in one lane that was positive stays so.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.common.errors import RunError
from harness.truth.frame import STEP_S, Frame
from harness.truth.network.network import Network
from harness.truth.sumo.brokendown import BROKEN_DOWN
from harness.truth.sumo.control import TrafficControl
from harness.truth.sumo.reading import read_frame, read_load
from harness.truth.sumo.session import FIRST_VEHICLE_WITHIN_S, RunningSumo
from harness.truth.sumo.smoothing import LEAD_FRAMES, hann_weights, rounded
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import NO_LANE

START_WINDOW_M = 60.0
CAR_LENGTH_M = (3.0, 6.5)
SMOOTHED = ("lon_m", "lat_m", "heading_rad", "speed_mps", "lat_speed_mps", "accel_mps2")


class CorridorTraffic:
    """Traffic of a network with a main road; see ``harness.truth.sumo.simulation.RoadTraffic``."""

    lead = LEAD_FRAMES
    waits_s = 0.0
    jumpy: tuple[str, ...] = ("heading_rad", "lat_speed_mps", "accel_mps2")

    def __init__(self, running: RunningSumo, network: Network, control: TrafficControl | None) -> None:
        """Take over a simulation, which a control may hold at a demand."""
        self._road = network.corridor_road
        self._running, self._network, self._control = running, network, control
        if control is not None:
            running.before_step = control.before_step

    def fill(self) -> None:
        """Put the first vehicles on the road."""
        if self._control is not None:
            self._control.fill()

    def wait(self) -> None:
        """Go on until a vehicle is in the section."""
        for _ in range(round(FIRST_VEHICLE_WITHIN_S / STEP_S)):
            if read_load(self._running.sumo, self._road).inside:
                return
            self._running.advance()
        raise RunError(f"no vehicle entered the section of {self._network.name} within {FIRST_VEHICLE_WITHIN_S:g} s")

    def read(self) -> Frame:
        """Return the vehicles as they are now."""
        return self.present(0)

    def present(self, step: int) -> Frame:
        """Return the vehicles as they are now, as a frame."""
        return read_frame(self._running.sumo, self._road, step)

    def frame(self, window: Sequence[Frame], step: int, ego: str | None) -> Frame | None:
        """Return the smoothed frame, seen from the ego or the one that follows it."""
        frame = smoothed(window, self._road, step)
        if ego is None:
            return frame
        row = choose_ego(frame, ego, self._network.ego_lanes, self._road.section_m)
        return None if row is None else replace(frame, ego=row)


def smoothed(window: Sequence[Frame], road: CorridorRoad, step: int) -> Frame:
    """Return the frame in the middle of a window, averaged over all of it; who is not in all of them is left out."""
    middle = len(window) // 2
    rows = [{name: row for row, name in enumerate(frame.vehicle_id.tolist())} for frame in window]
    always = set(rows[0]).intersection(*rows)
    kept = [name for name in rows[middle] if name in always]
    at = np.array([[present[name] for name in kept] for present in rows], dtype=np.int64)
    totals = np.zeros((len(SMOOTHED), len(kept)))
    for frame, chosen, weight in zip(window, at, hann_weights(middle), strict=True):
        totals += weight * np.stack([getattr(frame, column)[chosen] for column in SMOOTHED])
    values = dict(zip(SMOOTHED, rounded(totals), strict=True))
    classes = window[middle].vehicle_class
    return replace(
        window[middle],
        step=step,
        time_s=round(step * STEP_S, 6),
        vehicle_id=window[middle].vehicle_id[at[middle]],
        lane=road.lane_number_at(values["lon_m"], values["lat_m"]),
        length_m=rounded(window[middle].length_m[at[middle]]),
        width_m=rounded(window[middle].width_m[at[middle]]),
        vehicle_class=None if classes is None else classes[at[middle]],
        **values,
    )


def choose_ego(frame: Frame, present: str, ego_lanes: Sequence[int], section_m: tuple[float, float]) -> int | None:
    """Return the row of the present ego while it is on the section's lanes, else of another; None if there is none.

    A car on one of ``ego_lanes`` within 60 m of the section's start comes first; failing that the best there is, but
    none that has broken down.
    """
    inside = (frame.lon_m >= section_m[0]) & (frame.lon_m < section_m[1]) & (frame.lane != NO_LANE)
    if (stays := np.flatnonzero(inside & (frame.vehicle_id == present))).size:
        return int(stays[0])
    rows = np.flatnonzero(inside & ~np.char.startswith(frame.vehicle_id, BROKEN_DOWN))
    if not len(rows):
        return None
    lon_m, length_m = frame.lon_m[rows] - section_m[0], frame.length_m[rows]
    no_car = (length_m < CAR_LENGTH_M[0]) | (length_m > CAR_LENGTH_M[1])
    wrong_lane = ~np.isin(frame.lane[rows], np.asarray(ego_lanes))
    # The last key is the most important one.
    return int(rows[np.lexsort((lon_m, np.maximum(0.0, lon_m - START_WINDOW_M), no_car, wrong_lane))[0]])
