"""A run's tables for the page's replay: typed arrays as base64, with row ranges by step."""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import shapely

from harness.running.finished import RecordedRun
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M, OUTCOMES, VISIBILITY_STATES
from harness.storage.tables import floats
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.tracks import TRACK_STATES

# Vehicles beyond the sensor are shown this far, so that those that come into range do not spring up.
BEYOND_RANGE_M = 40.0
MOST_BYTES = 6_000_000
NO_ERROR_CM = 65_535
FAR_M = 1e5
Packing = tuple[str, str, float]
"""How a column is packed: its name in the table, the type, which whole numbers are clipped to, and a factor."""
PLACE: dict[str, Packing] = {"lon": ("lon_m", "f4", 1.0), "lat": ("lat_m", "f4", 1.0)}
OF_VEHICLES = PLACE | {
    "heading": ("heading_rad", "i2", 1e4),
    "speed": ("speed_mps", "i2", 10.0),
    "visible": ("visible_fraction", "u1", 100.0),
}
OF_TRACKS = PLACE | {"std_lon": ("std_lon_m", "u2", 100.0), "std_lat": ("std_lat_m", "u2", 100.0)}
"""Columns of numbers that the picture needs, by their packed names."""
UNPLOTTED = ("time_s", "length_m", "width_m", "window_start_m", "window_end_m")
OF_TRACKER = ("error", "track", "outcome")
"""What of the truth's columns a tracker decides."""


@dataclass(frozen=True)
class SecondRun:
    """A second tracker on the same detections.

    ``marks`` tell where the two differ: columns ``step``, ``vehicle_id``, ``kind`` and ``side``, 0 or 1 for the one
    that is worse there, sorted by step. ``opens_at`` is the time in seconds and vehicle at which the replay opens.
    """

    run: RecordedRun
    marks: pd.DataFrame
    opens_at: tuple[float, str] | None


def replay_data(run: RecordedRun, beside: SecondRun | None = None) -> dict[str, Any]:
    """Return what the replay shows of a run, perhaps with another tracker, ready for JSON.

    Positions are in the road frame, metres, as 32-bit floats; headings in units of 1e-4 rad; errors, sizes and standard
    deviations in centimetres; speeds in decimetres a second. A run too long for a page is shown in every second, third,
    ... step.
    """
    reach_m = run.sensor.range_m + BEYOND_RANGE_M
    truth = run.truth
    if beside is None and run.commands is not None:
        # In the ego's rows stands what its driver demands, by the truth and by the tracks.
        by_step = run.commands.set_index("step")[["truth_mps2", "tracks_mps2"]]
        demands = by_step.reindex(truth["step"]).to_numpy(dtype=np.float64)
        demands[~truth["is_ego"].to_numpy(dtype=bool)] = np.nan
        truth = truth.assign(demanded_by_truth_mps2=demands[:, 0], demanded_by_tracks_mps2=demands[:, 1])
    away_m = (np.abs(_away_from_ego(truth, truth, name)) for name in ("lon_m", "lat_m"))
    kept_truth = truth[np.maximum(*away_m) <= reach_m]
    size = _bytes(run, kept_truth) + (0 if beside is None else _bytes(beside.run, kept_truth))
    stride = 1 + size // MOST_BYTES
    times = run.truth.drop_duplicates("step")[["step", "time_s", "episode"]].iloc[::stride]
    steps = times["step"].to_numpy(dtype=np.int64)
    codes, names = pd.factorize(kept_truth["vehicle_id"])
    first = np.unique(codes, return_index=True)[1]
    data: dict[str, Any] = {
        "time_s": np.round(times["time_s"], 3).tolist(),
        "episode": times["episode"].tolist(),
        "range_m": run.sensor.range_m,
        "field_of_view_deg": run.sensor.field_of_view_deg,
        "follow_m": FOLLOW_CUTOFF_M,
        "road": (_plane(run.road, run, reach_m) if isinstance(run.road, LaneGraphRoad) else _strips(run))
        | {"reference_xy": [*map(list, run.road.reference_xy)], "reference_start_m": run.road.reference_start_m},
        "vehicles": {
            "names": [str(name) for name in names],
            **{name: np.round(kept_truth[name].to_numpy()[first], 2).tolist() for name in ("length_m", "width_m")},
        },
        "truth": _truth(kept_truth, run.errors, codes, steps),
        "detections": _detections(run.detections, steps, run.road),
        "tracks": _tracks(run.tracks, steps),
        "particles": _particles(run, steps),
        "unseen": _unseen(run, steps),
        "events": _events(run.events, steps, names),
        "outcomes": ["", *OUTCOMES],
        "plots": _plots(kept_truth, run.tracks),
    }
    if beside is not None:
        of_truth = _truth(kept_truth, beside.run.errors, codes, steps)
        data["other"] = {
            "truth": {name: of_truth[name] for name in OF_TRACKER},
            "tracks": _tracks(beside.run.tracks, steps),
            "particles": _particles(beside.run, steps),
            "unseen": _unseen(beside.run, steps),
        }
        marked = names.get_indexer(pd.Index(beside.marks["vehicle_id"].astype("object")))
        shown = beside.marks.assign(vehicle=marked)[marked >= 0]
        data["marks"] = _rows(shown, steps, **_as_they_are(vehicle="u2", kind="u1", side="u1"))
        data["opens_at"] = beside.opens_at
    return data


def pack(values: npt.ArrayLike, kind: str) -> dict[str, str]:
    """Return an array as its type (``f4``, ``u2``, ...) and its bytes, little-endian, as base64."""
    array = np.asarray(values).astype(f"<{kind}")
    return {"type": kind, "data": base64.b64encode(array.tobytes()).decode("ascii")}


def _away_from_ego(table: pd.DataFrame, truth: pd.DataFrame, column: str) -> FloatArray:
    """Return by how much the places in a table differ from the ego's at that step in one direction, metres."""
    ego = truth[truth["is_ego"].to_numpy(dtype=bool)].set_index("step")[column]
    return np.asarray(table[column].to_numpy(dtype=np.float64) - ego.reindex(table["step"]).to_numpy(dtype=np.float64))


def _bytes(run: RecordedRun, truth: pd.DataFrame) -> int:
    particles = 0 if run.particles is None else len(run.particles)
    return 35 * len(truth) + 12 * len(run.detections) + 37 * len(run.tracks) + 4 * particles


def _strips(run: RecordedRun) -> dict[str, Any]:
    """Return the strips of a single road, and the ramps beside it."""
    ends_m = [np.clip([lane.start_m, lane.end_m], -FAR_M, FAR_M).tolist() for lane in run.road.lanes]
    return {
        "lanes": [[lane.right_m, lane.left_m, *ends] for lane, ends in zip(run.road.lanes, ends_m, strict=True)],
        "ramps": [np.round(outline, 1).tolist() for outline in run.ramps],
    }


def _plane(road: LaneGraphRoad, run: RecordedRun, reach_m: float) -> dict[str, Any]:
    """Return the lanes and walls near the ego's way, as lines in the plane."""
    ego = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)].iloc[::10]
    way = shapely.MultiPoint(ego[["lon_m", "lat_m"]].to_numpy()).buffer(reach_m)
    shapely.prepare(way)
    lines = [line for line in road.lines() if way.intersects(shapely.LineString(line.xy))]
    ends = road.walls_near(0.0, 0.0, np.inf).reshape(-1, 2, 2)
    walls = [wall.ravel() for wall in ends if way.intersects(shapely.LineString(wall))]
    return {
        "lanes": [],
        "lines": [
            {"xy": np.round(line.xy, 2).tolist(), "width": round(line.width_m, 2), "junction": line.in_junction}
            for line in lines
        ],
        "walls": [np.round(wall, 2).tolist() for wall in walls],
    }


def _truth(truth: pd.DataFrame, errors: pd.DataFrame, codes: npt.NDArray[np.intp], steps: IntArray) -> dict[str, Any]:
    """Pack the truth with each row's distance to its track, that track (-1 if none) and its outcome (0 if none)."""
    place = ["step", "vehicle_id"]
    beside = truth[place].astype({"vehicle_id": object}).merge(errors.astype({"vehicle_id": object}), "left", on=place)
    error_cm = 100.0 * np.hypot(floats(beside, "lon_error_m"), floats(beside, "lat_error_m"))
    columns = truth.assign(
        vehicle=codes,
        state=_codes(truth["state"], VISIBILITY_STATES),
        ego=truth["is_ego"],
        error=np.where(np.isfinite(error_cm), np.minimum(error_cm, NO_ERROR_CM - 1), NO_ERROR_CM),
        track=beside["track_id"].fillna(-1).to_numpy(),
        outcome=1 + _codes(beside["outcome"], OUTCOMES),
    )
    own = _as_they_are(vehicle="u2", state="u1", ego="u1", error="u2", track="i4", outcome="u1")
    return _rows(columns, steps, **OF_VEHICLES, **own, **_others(truth, OF_VEHICLES))


def _detections(detections: pd.DataFrame, steps: IntArray, road: Road) -> dict[str, Any]:
    """Pack the detections with the sizes that cast their shadows: the measured ones, or else a mean car's."""
    mean_car = {"length_m": NOMINAL_LENGTH_M, "width_m": NOMINAL_WIDTH_M}
    unmeasured = {name: size for name, size in mean_car.items() if name not in detections}
    turn = road.axis_of(road.lane_heading_at(floats(detections, "lon_m"), floats(detections, "lat_m")))
    sizes: dict[str, Packing] = {"length": ("length_m", "u2", 100.0), "width": ("width_m", "u2", 100.0)}
    turned: dict[str, Packing] = {"turn": ("turn", "i2", 1e4)} if turn.any() else {}
    return _rows(detections.assign(**unmeasured, turn=turn), steps, **PLACE, **sizes, **turned)


def _tracks(tracks: pd.DataFrame, steps: IntArray) -> dict[str, Any]:
    columns = tracks.assign(state=_codes(tracks["state"], TRACK_STATES))
    own: dict[str, Packing] = {"id": ("track_id", "i4", 1.0), "state": ("state", "u1", 1.0)}
    return _rows(columns, steps, **own, **OF_TRACKS, **_others(tracks, OF_TRACKS))


def _as_they_are(**kinds: str) -> dict[str, Packing]:
    """Return how columns are packed whose numbers keep their names and their sizes, given their types."""
    return {name: (name, kind, 1.0) for name, kind in kinds.items()}


def _others(table: pd.DataFrame, known: Mapping[str, Packing]) -> dict[str, Packing]:
    """Return how the columns of numbers are packed that nothing but a plot over time shows."""
    left_out = {*UNPLOTTED, *(column for column, _, _ in known.values())}
    return {
        str(name): (str(name), "f4", 1.0) for name in table if table[name].dtype.kind == "f" and name not in left_out
    }


def _plots(truth: pd.DataFrame, tracks: pd.DataFrame) -> list[tuple[str, str, str, float]]:
    """Return what may be plotted over time: its name, ``truth`` or ``tracks``, the packed column and its factor."""
    plots = [("distance to its track, m", "truth", "error", 100.0)]
    shown = (("vehicle", "truth", truth, OF_VEHICLES), ("its track", "tracks", tracks, OF_TRACKS))
    for whose, table, packed, known in shown:
        columns = known | _others(packed, known)
        plots += [(f"{whose}: {column}", table, key, factor) for key, (column, _, factor) in columns.items()]
    return plots


def _particles(run: RecordedRun, steps: IntArray) -> dict[str, Any] | None:
    """Pack the particles relative to the ego, longitudinally in decimetres and laterally in centimetres."""
    if run.particles is None:
        return None
    away_m = {f"away_{name}": _away_from_ego(run.particles, run.truth, name) for name in ("lon_m", "lat_m")}
    columns = run.particles.assign(**away_m)
    return _rows(columns, steps, away=("away_lon_m", "i2", 10.0), lat=("away_lat_m", "i2", 100.0))


def _unseen(run: RecordedRun, steps: IntArray) -> dict[str, Any] | None:
    """Pack the stretches of lane with the vehicles expected there, in thousandths, at the shown steps nearest after."""
    if run.unseen is None:
        return None
    step = run.unseen["step"].to_numpy(dtype=np.int64)
    shown = steps[np.minimum(np.searchsorted(steps, step), len(steps) - 1)]
    latest = pd.Series(step).groupby(shown).transform("max").to_numpy() == step
    ends = {"lon": "from_lon_m", "lat": "from_lat_m", "to_lon": "to_lon_m", "to_lat": "to_lat_m"}
    places: dict[str, Packing] = {name: (column, "f4", 1.0) for name, column in ends.items()}
    return _rows(run.unseen.assign(step=shown)[latest], steps, **places, expected=("expected", "u2", 1e3))


def _events(events: pd.DataFrame, steps: IntArray, names: pd.Index) -> list[list[Any]]:
    """Return the occlusion events as (vehicle, first and last index of a shown step, outcome)."""
    vehicle = names.get_indexer(pd.Index(events["vehicle_id"].astype("object")))
    start = np.searchsorted(steps, events["from_step"].to_numpy())
    end = np.minimum(np.searchsorted(steps, events["to_step"].to_numpy()), len(steps) - 1)
    rows = zip(vehicle.tolist(), start.tolist(), end.tolist(), events["outcome"].tolist(), strict=True)
    return [list(row) for row in rows if row[0] >= 0]


def _rows(table: pd.DataFrame, steps: IntArray, **columns: Packing) -> dict[str, Any]:
    """Pack the rows of the shown steps of a table, which is sorted by step.

    Beside the columns stands ``first``: where each step's rows begin, and the end of the last.
    """
    step = table["step"].to_numpy(dtype=np.int64)
    shown = np.isin(step, steps)
    packed: dict[str, Any] = {"first": pack(np.append(np.searchsorted(step[shown], steps), shown.sum()), "u4")}
    for name, (column, kind, factor) in columns.items():
        values = factor * table[column].to_numpy(dtype=np.float64)[shown]
        if not kind.startswith("f"):
            limits = np.iinfo(kind)
            values = np.clip(np.rint(np.nan_to_num(values)), limits.min, limits.max)
        packed[name] = pack(values, kind)
    return packed


def _codes(values: "pd.Series[str]", names: tuple[str, ...]) -> IntArray:
    return np.asarray(pd.Index(names).get_indexer(pd.Index(values.astype("object"))), dtype=np.int64)
