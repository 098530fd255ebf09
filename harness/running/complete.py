"""Derives what a log's files lack: the ego, speeds from positions, visibility from boxes, origins of detections."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from harness.common.bounds import check_moves
from harness.common.errors import InputError
from harness.config.sensor import SensorSettings
from harness.running.recorder import columns_of, frame_of
from harness.sensor.detector import states_of, view_of
from harness.storage import run_folder as runfolder
from harness.storage.schema import HIDDEN, NOMINAL_LENGTH_M, NOMINAL_WIDTH_M, OUT, TABLES, VISIBILITY_STATES
from harness.storage.tables import rows_of_steps
from harness.truth.recorded.detected.origin import GATE_M, pairs_within
from harness.truth.recorded.detected.recorded_drive import EGO
from harness.truth.recorded.order import LONGEST_INTERVAL_S
from harness.truth.recorded.plausible import MOST_WITHIN, SIZE_CHANGE_RATIO
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import FloatArray, turned, wrapped

SIZE = ["length_m", "width_m"]
EGO_SIZE_M, NOMINAL_SIZE_M = (4.8, 1.8), (NOMINAL_LENGTH_M, NOMINAL_WIDTH_M)
USUAL_OF_DETECTIONS = {"speed_mps": np.nan, "std_speed_mps": 1.0, "std_lon_m": 0.5, "std_lat_m": 0.5}
"""What stands for figures that a file of detections does not tell; no score of tracks depends on deviations."""
SEEN = ["visible_fraction", "state", "in_range", "occluder_id"]
KEYS = ["episode", "time_s"]
OF_POSES = ["lon_m", "lat_m", "heading_rad", "speed_mps", "length_m", "width_m"]
MOST_AT_ONCE = 2000
ON_TIME = 0.1
"""How far a row may be from a time of the truth to be of that time, as a share of a step."""


def check_scene(place: str, rows: pd.DataFrame) -> None:
    """Refuse rows of a truth that is too dense, pauses for long, or whose vehicles move or change as nothing does."""
    if (most := rows.groupby(KEYS).size().max()) > MOST_AT_ONCE:
        raise InputError(f"{place}: {most} vehicles at one time; at most {MOST_AT_ONCE} are scored")
    pause_s = rows[KEYS].drop_duplicates().sort_values(KEYS).groupby("episode")["time_s"].diff().max()
    if pause_s > LONGEST_INTERVAL_S:
        raise InputError(f"{place}: {pause_s:g} s pass between two of its times; mend the times, or cut it")
    sizes = rows.groupby(["episode", "id"])[SIZE if "length_m" in rows else []]
    growth = (sizes.max() / sizes.min()).max(axis=1)
    if growth.max() > SIZE_CHANGE_RATIO:
        name = str(growth.index.to_list()[int(growth.argmax())][1])
        raise InputError(f"{place}: {name[:60]} changes its size; mend length_m and width_m")
    rows = rows if "heading_rad" in rows else rows.assign(heading_rad=np.nan)
    for is_ego, own in rows.groupby(rows["is_ego"].astype(bool)):
        alone = rows["episode"].min() == rows["episode"].max()
        drive = "" if alone else " of drive " + own["episode"].astype(str)
        who = (own["id"].astype(str) + drive).to_numpy(dtype=np.str_)
        time_s, x_m, y_m, heading_rad = own[["time_s", "lon_m", "lat_m", "heading_rad"]].to_numpy(dtype=np.float64).T
        check_moves(place, who, time_s, x_m, y_m, heading_rad, bool(is_ego))
    if rows.duplicated([*KEYS, "lon_m", "lat_m"]).mean() > MOST_WITHIN:
        raise InputError(f"{place}: vehicles are in one place, and often; leave one of each, or mend the places")


def sample_times(rows: pd.DataFrame, ego: pd.DataFrame | None, step_s: float) -> dict[str, tuple[int, float]]:
    """Return the episode and time of each sample of nuScenes, from the poses or else from the samples' order."""
    if "sample_token" not in rows:
        return {}
    if ego is not None and "sample_token" in ego:
        known = ego[["sample_token", *KEYS]].itertuples(index=False)
        return {token: (int(episode), float(time_s)) for token, episode, time_s in known}
    if "order" not in rows:
        raise InputError("`ego`: the truth is a table of samples; give the sensor's poses with sample_token and time_s")
    order = rows.drop_duplicates("sample_token")[["sample_token", "order"]].itertuples(index=False)
    return {token: (0, place * step_s) for token, place in order}


def with_times(rows: pd.DataFrame, moments: Mapping[str, tuple[int, float]]) -> pd.DataFrame:
    """Return rows with the episode and time of their samples, as ``sample_times`` gives them; others as they are."""
    if "sample_token" not in rows:
        return rows
    known = rows[rows["sample_token"].isin(list(moments))]
    if not len(known) and len(rows):
        raise InputError("the samples of the files are not the same; give results of the same split")
    at = np.array([moments[token] for token in known["sample_token"]], dtype=np.float64).reshape(-1, 2)
    return known.assign(episode=at[:, 0].astype(np.int64), time_s=at[:, 1])


def with_ego(rows: pd.DataFrame, ego: pd.DataFrame | None, asked: str | None, truth: Path) -> pd.DataFrame:
    """Return the rows of which one at each time is the ego; times at which its pose is not known are left out."""
    if ego is None and asked is not None and not Path(asked).exists():
        if not (rows["id"].astype(str) == asked).any():
            raise InputError(f"`ego` {asked}: it is no file, and no vehicle of {truth} is called so")
        return rows.assign(is_ego=rows["id"].astype(str) == asked)
    if ego is None:
        if "is_ego" not in rows or not rows["is_ego"].any():
            raise InputError(f"`ego`: no row of {truth} is_ego; name a vehicle, or a file of the sensor's poses")
        flagged = rows.loc[rows["is_ego"].astype(bool), KEYS].drop_duplicates()
        return rows.merge(flagged, on=KEYS)
    parts = [rows.assign(is_ego=False)]
    for episode, times in rows.drop_duplicates(KEYS).groupby("episode")["time_s"]:
        way = ego[ego["episode"] == episode].sort_values("time_s")
        at, own = np.sort(times.to_numpy(dtype=np.float64)), way["time_s"].to_numpy(dtype=np.float64)
        at = at[(at >= own.min(initial=np.inf) - 1e-6) & (at <= own.max(initial=-np.inf) + 1e-6)]
        if not len(at):
            raise InputError(f"`ego`: {asked} has no pose at the times of {truth}")
        values = {name: way[name].to_numpy(dtype=np.float64) for name in way.columns.intersection(OF_POSES)}
        values["heading_rad"] = np.unwrap(values["heading_rad"])
        poses = {name: np.interp(at, own, value) for name, value in values.items()}
        poses["heading_rad"] = wrapped(poses["heading_rad"])
        parts.append(pd.DataFrame({"episode": episode, "time_s": at, "id": EGO, "is_ego": True, **poses}))
    joined = pd.concat(parts, ignore_index=True)
    return joined.merge(joined.loc[joined["is_ego"].astype(bool), KEYS], on=KEYS)


def truth_table(rows: pd.DataFrame, road: Road, figures: SensorSettings) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of truth, and a row for each step with its episode and its ``own`` time in the file.

    Args:
        rows: Rows as ``harness.truth.recorded.logs`` reads them, one at each time the ego.
    """
    clock = _clock(rows)
    rows = rows.drop(columns=["step", "own"], errors="ignore").rename(columns={"time_s": "own"})
    rows = rows.merge(clock, on=["episode", "own"]).sort_values(["step"], kind="stable").reset_index(drop=True)
    rows["vehicle_id"], rows["is_ego"] = rows["id"].astype(str), rows["is_ego"].astype(bool)
    for column, of_ego, usual in zip(SIZE, EGO_SIZE_M, NOMINAL_SIZE_M, strict=True):
        rows[column] = filled(rows, column, np.where(rows["is_ego"], of_ego, usual))
    # From places, in the plane along the heading.
    lon_speed, lat_speed = (slope_of(rows, name) for name in ("lon_m", "lat_m"))
    rows["heading_rad"] = filled(rows, "heading_rad", np.arctan2(lat_speed, lon_speed))
    lon_speed, lat_speed = turned(lon_speed, lat_speed, road.axis_of(rows["heading_rad"].to_numpy()))
    rows["speed_mps"] = filled(rows, "speed_mps", lon_speed)
    rows["lat_speed_mps"] = filled(rows, "lat_speed_mps", lat_speed)
    rows["accel_mps2"] = filled(rows, "accel_mps2", slope_of(rows, "speed_mps"))
    if road.has_headings:
        rows["direction_rad"] = rows["heading_rad"]
        rows["lane"] = NO_LANE
    elif "lane" not in rows and isinstance(road, CorridorRoad):
        rows["lane"] = road.lane_number_at(*(rows[name].to_numpy(dtype=np.float64) for name in ("lon_m", "lat_m")))
    if not set(SEEN) <= set(rows):
        _observe(rows, road, figures)
    table = TABLES[runfolder.TRUTH]
    return rows[[column.name for column in table.columns if column.name in rows]], clock


def _clock(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the steps: episodes follow each other, a usual step apart."""
    clock = rows[KEYS].drop_duplicates().sort_values(KEYS).rename(columns={"time_s": "own"}).reset_index(drop=True)
    step_s = _step_of(clock)
    gone = clock.groupby("episode")["own"].transform("min")
    length = clock.groupby("episode")["own"].agg(lambda own: own.max() - own.min() + step_s)
    before = clock["episode"].map(length.cumsum().shift(fill_value=0.0))
    return clock.assign(step=np.arange(len(clock)), time_s=np.round(clock["own"] - gone + before, 6))


def _step_of(clock: pd.DataFrame) -> float:
    steps = clock.groupby("episode")["own"].diff().dropna()
    return float(steps.median()) if len(steps) else 0.1


def filled(rows: pd.DataFrame, column: str, usual: FloatArray | float) -> FloatArray:
    """Return a column, shape (n,), with the usual value, of each row or of all, where it is missing or not finite."""
    values = rows[column].to_numpy(dtype=np.float64) if column in rows else np.full(len(rows), np.nan)
    return np.where(np.isfinite(values), values, usual)


def slope_of(rows: pd.DataFrame, column: str) -> FloatArray:
    """Return the rise of a column per second along each identity, by central differences, shape (n,)."""
    slope = np.zeros(len(rows))
    for _, own in rows.sort_values("time_s").groupby(["episode", "id"], sort=False):
        if len(own) > 1:
            slope[own.index] = np.gradient(own[column].to_numpy(dtype=np.float64), own["time_s"].to_numpy())
    return slope


def _observe(rows: pd.DataFrame, road: Road, figures: SensorSettings) -> None:
    """Work out what the sensor could see of each vehicle, from the boxes."""
    fraction, in_range = np.zeros(len(rows)), np.zeros(len(rows), dtype=bool)
    state = np.full(len(rows), OUT)
    names, covering = rows["vehicle_id"].to_numpy(dtype=object), np.full(len(rows), "", dtype=object)
    columns = columns_of(rows.drop(columns=SEEN, errors="ignore"), runfolder.TRUTH)
    for place in rows_of_steps(rows).values():
        frame = frame_of({name: values[place] for name, values in columns.items()})
        scene, _ = view_of(figures, frame, road)
        fraction[place], in_range[place] = np.round(scene.fraction, 4), scene.in_range
        covering[place] = np.append(names[place], "")[scene.occluder]
        state[place] = states_of(figures, scene.fraction, scene.in_range)
    rows["visible_fraction"], rows["in_range"], rows["occluder_id"] = fraction, in_range, covering
    rows["state"] = np.array(VISIBILITY_STATES, dtype=object)[state]


def detection_table(found: pd.DataFrame | None, truth: pd.DataFrame, clock: pd.DataFrame) -> pd.DataFrame:
    """Return the table of detections, each with the vehicle that it is of.

    Args:
        found: Rows as they were read; None if every vehicle that is not hidden counts as detected.
        clock: See ``truth_table``.
    """
    if found is None:
        unseen = [VISIBILITY_STATES[HIDDEN], VISIBILITY_STATES[OUT]]
        seen = truth[~truth["is_ego"] & ~truth["state"].isin(unseen)]
        rows = seen[["step", *KEYS, "lon_m", "lat_m", "visible_fraction"]].assign(truth_id=seen["vehicle_id"])
    else:
        rows = on_clock(found, clock, "detections").reset_index(drop=True)
        if "id" not in found:
            rows["truth_id"] = _origins(rows, truth)
        seen_of = truth.set_index(["step", "vehicle_id"])["visible_fraction"]
        of = pd.MultiIndex.from_arrays([rows["step"], rows["truth_id"].astype(str)])
        rows["visible_fraction"] = seen_of.reindex(of).to_numpy()
        rows.loc[rows["visible_fraction"].isna(), "truth_id"] = ""
    rows = rows.sort_values("step", kind="stable").reset_index(drop=True)
    rows["detection"] = rows.groupby("step").cumcount()
    for name, usual in USUAL_OF_DETECTIONS.items():
        rows[name] = filled(rows, name, usual)
    rows["std_speed_mps"] = rows["std_speed_mps"].where(rows["speed_mps"].notna())
    return rows[list(TABLES[runfolder.DETECTIONS].needed)]


def _origins(rows: pd.DataFrame, truth: pd.DataFrame) -> list[str]:
    origin = np.full(len(rows), "", dtype=object)
    others = truth[~truth["is_ego"] & truth["in_range"]]
    at = dict(list(others.groupby("step")))
    for step, own in rows.groupby("step"):
        if (there := at.get(step)) is None:
            continue
        away = np.hypot(
            *(own[name].to_numpy(dtype=np.float64)[:, None] - there[name].to_numpy() for name in ("lon_m", "lat_m"))
        )
        row, column = pairs_within(away, GATE_M)
        origin[own.index.to_numpy()[row]] = there["vehicle_id"].to_numpy()[column]
    return [str(name) for name in origin]


def on_clock(rows: pd.DataFrame, clock: pd.DataFrame, role: str) -> pd.DataFrame:
    """Return the rows at a step's time, with its ``step`` and time, and how far ``off``; others are left out.

    Raises:
        InputError: Rows are between two steps, so that their places are those of another time.
    """
    step_s, steps = _step_of(clock), clock.sort_values("own").rename(columns={"time_s": "at_s"})
    rows = rows.drop(columns=["step", "own", "at_s"], errors="ignore").astype({"time_s": np.float64})
    if "episode" in rows and rows["episode"].nunique() == 1 < clock["episode"].nunique() and clock["own"].is_unique:
        rows = rows.drop(columns="episode")  # one file of several episodes: its times tell them
    near = pd.merge_asof(
        rows.sort_values("time_s", kind="stable"),
        steps.astype({"own": np.float64}),
        left_on="time_s",
        right_on="own",
        by="episode" if "episode" in rows else None,
        direction="nearest",
        tolerance=0.5 * step_s + 1e-6,  # type: ignore[arg-type]  # of floats a float, says pandas
    )
    near = near[near["step"].notna()]
    off = (near["time_s"] - near["own"]).abs()
    is_off = off > ON_TIME * step_s + 1e-6
    ends = clock.groupby("episode")["own"].agg(["min", "max"]).reindex(near["episode"]).to_numpy()
    if len(between := near[is_off & near["time_s"].between(ends[:, 0], ends[:, 1])]):
        at_s, own_s = between[["time_s", "own"]].iloc[0]
        told = f"{len(between)} rows are between the truth's times, the first at {at_s:.3f} s (nearest: {own_s:.3f} s)"
        raise InputError(f"`{role}`: {told}; give rows that are at most {ON_TIME * step_s:g} s from one of its times")
    near = near[~is_off]
    return near.assign(off=off, step=near["step"].astype(np.int64), time_s=near["at_s"]).drop(columns=["own", "at_s"])
