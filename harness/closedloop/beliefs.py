"""What the ego's driver believes at one step: the truth, a tracker's tracks, or a model of human perception."""

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from harness.decisions.belief import Belief, believe
from harness.decisions.bodies import Bodies, Egos
from harness.scoring.driving.believed import HEADING_M, HEADING_S
from harness.scoring.evidence.pairs import GATE_SIMILARITY, similarity
from harness.scoring.evidence.rules import DRIVER_EXISTENCE, TIME_TOLERANCE_S
from harness.sensor.observation import Snapshot
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from harness.truth.frame import Frame
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import Detections
from mmpf.tracks import TENTATIVE, Tracks

TRUTH = "truth"
"""The belief that no tracker's output enters."""


class Perception(Protocol):
    """Makes bodies that the driver believes in of each snapshot; asked once a snapshot, in order."""

    def bodies(self, snapshot: Snapshot, tracks: Tracks) -> Bodies:
        """Return what is believed of the vehicles around the ego, all of step 0."""


class TruePerception:
    """Every vehicle as it is, hidden or never seen."""

    def bodies(self, snapshot: Snapshot, tracks: Tracks) -> Bodies:  # noqa: ARG002
        """Return the vehicles; see ``Perception``."""
        return true_bodies(snapshot.frame)


@dataclass
class TrackedPerception:
    """The reported tracks, as large as detections on them measured so far; doubtful with an existence below one half.

    The same bodies as ``harness.scoring.driving.believed`` makes of a finished run's tables, a step at a time.
    """

    road: Road
    _places: dict[int, list[tuple[float, float, float]]] = field(default_factory=dict)
    _measured: dict[int, FloatArray] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))

    def bodies(self, snapshot: Snapshot, tracks: Tracks) -> Bodies:
        """Return the tracks; see ``Perception``."""
        reported = np.flatnonzero(tracks.state != TENTATIVE)
        self._measure(tracks, reported, snapshot.observation.scan.detections)
        sizes = np.array([self._size(int(number)) for number in tracks.track_id[reported]]).reshape(-1, 2)
        speed = tracks.speed_mps[reported]
        ego_mps = snapshot.frame.speed_mps[snapshot.frame.ego]
        return Bodies(
            step=np.zeros(len(reported), dtype=np.int64),
            lon_m=tracks.lon_m[reported],
            lat_m=tracks.lat_m[reported],
            speed_mps=np.where(np.isfinite(speed), speed, ego_mps),
            direction_rad=self._directions(snapshot, tracks, reported),
            length_m=sizes[:, 0],
            width_m=sizes[:, 1],
            doubtful=tracks.existence[reported] < DRIVER_EXISTENCE,
        )

    def _directions(self, snapshot: Snapshot, tracks: Tracks, reported: IntArray) -> FloatArray:
        """Return the axis of each track that moves as in the last half second, nan where it hardly did, shape (k,)."""
        now_s, places = snapshot.frame.time_s, {}
        for row in reported:
            name = int(tracks.track_id[row])
            before = [place for place in self._places.get(name, ()) if place[0] >= now_s - HEADING_S - TIME_TOLERANCE_S]
            places[name] = [*before, (now_s, float(tracks.lon_m[row]), float(tracks.lat_m[row]))]
        self._places = places
        moved = np.array([np.subtract(places[n][-1], places[n][0])[1:] for n in tracks.track_id[reported].tolist()])
        lon_m, lat_m = moved.reshape(-1, 2).T
        return self.road.axis_of(np.where(np.hypot(lon_m, lat_m) >= HEADING_M, np.arctan2(lat_m, lon_m), np.nan))

    def _measure(self, tracks: Tracks, reported: IntArray, found: Detections) -> None:
        """Add what the detection nearest to each reported track measures of its size."""
        sizes = found.sizes
        if sizes is None or not len(reported):
            return
        whole = np.flatnonzero(np.isfinite(sizes.length_m + sizes.width_m))
        if not len(whole):
            return
        lon_m = found.lon_m[whole, None] - tracks.lon_m[reported]
        lat_m = found.lat_m[whole, None] - tracks.lat_m[reported]
        alike = similarity(lon_m, lat_m)
        nearest = alike.argmax(axis=0)
        for place, row in enumerate(nearest):
            if alike[row, place] >= GATE_SIMILARITY:
                size = sizes.length_m[whole[row]], sizes.width_m[whole[row]], 1.0
                self._measured[int(tracks.track_id[reported[place]])] += size

    def _size(self, track_id: int) -> tuple[float, float]:
        length, width, count = self._measured.get(track_id, np.zeros(3))
        return (length / count, width / count) if count else (NOMINAL_LENGTH_M, NOMINAL_WIDTH_M)


def true_bodies(frame: Frame) -> Bodies:
    """Return the vehicles of a frame, or the chosen ones, without the ego."""
    kept = np.flatnonzero(np.arange(len(frame)) != frame.ego)
    return Bodies(
        step=np.zeros(len(kept), dtype=np.int64),
        lon_m=frame.lon_m[kept],
        lat_m=frame.lat_m[kept],
        speed_mps=frame.speed_mps[kept],
        direction_rad=frame.axis_rad[kept],
        length_m=frame.length_m[kept],
        width_m=frame.width_m[kept],
    )


def ego_of(frame: Frame, route: tuple[int, ...] = ()) -> Egos:
    """Return the ego of a frame as a single step, and the lanes that its way goes by."""
    at = slice(frame.ego, frame.ego + 1)
    return Egos(
        episode=np.zeros(1, dtype=np.int64),
        lon_m=frame.lon_m[at],
        lat_m=frame.lat_m[at],
        speed_mps=frame.speed_mps[at],
        lane=frame.lane[at],
        length_m=frame.length_m[at],
        width_m=frame.width_m[at],
        route=route,
    )


def believed_by_each(frame: Frame, rows: IntArray, road: Road) -> Belief:
    """Return what the vehicles of some rows would believe by the truth, each the ego in turn, a step each.

    A body is a row of the frame plus a multiple of the frame's size.
    """
    count, size = len(rows), len(frame)

    def repeated(values: FloatArray) -> FloatArray:
        return np.tile(values, count)

    bodies = Bodies(
        step=np.repeat(np.arange(count), size),
        lon_m=repeated(frame.lon_m),
        lat_m=repeated(frame.lat_m),
        speed_mps=repeated(frame.speed_mps),
        direction_rad=np.zeros(count * size),
        length_m=repeated(frame.length_m),
        width_m=repeated(frame.width_m),
    )
    own = {name: getattr(frame, name)[rows] for name in ("lon_m", "lat_m", "speed_mps", "lane", "length_m", "width_m")}
    return believe(bodies, Egos(episode=np.zeros(count, dtype=np.int64), **own), road)
