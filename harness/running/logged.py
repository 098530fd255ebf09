"""Scores a log: truth and tracks from any source become a run folder through the same evaluation.

Whatever the files lack is worked out: what of each vehicle the sensor could see, from the boxes; which vehicle a
detection is of, the nearest within two metres; speeds, from places. Without detections every vehicle that is not hidden
counts as detected, where it is.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from harness.common.bounds import Numbers, check_numbers
from harness.common.error_text import shown
from harness.common.errors import InputError
from harness.common.isolation import trusted
from harness.common.signals import signals_held
from harness.config.layers import config_from_table, merged
from harness.config.model import RecordingConfig, RunConfig, TrackerConfig, TrafficConfig
from harness.running import complete
from harness.running.evaluate import evaluation_of, write_run
from harness.running.log_options import Logs
from harness.running.nuscenes_boxes import nuscenes_scores
from harness.running.replay import read_snapshots, snapshots_of
from harness.running.resolve import resolve_run_config
from harness.running.snapshots import SnapshotStream
from harness.scoring.metrics.scarce import check_scored
from harness.sensor.profiles import sensor_settings
from harness.storage import run_folder as runfolder
from harness.storage.road_file import read_road
from harness.trackers.wellformed import fault_of
from harness.truth.frame import ROAD_OF_RECORDING
from harness.truth.recorded.detected.recorded_drive import EGO
from harness.truth.recorded.logs import DETECTIONS, TRACKS, TRUTH, LogFile, read_poses_table, split_topic
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.scan import Scan
from mmpf.tracks import CONFIRMED, TRACK_STATES, Tracks

NUMBERS = re.compile(r"_(m|s|mps|mps2|rad)$|^existence$")
STDS = ("std_lon_m", "std_lat_m", "std_speed_mps")
LEAST_PLACED = 0.01
"""Which share of a log's rows are at a time of the truth at least: times in milliseconds agree at one in thousands."""


@dataclass(frozen=True)
class Scored:
    """What a log is scored against.

    Attributes:
        clock: See ``harness.running.complete.truth_table``.
        moments: Episode and time of each sample of nuScenes.
    """

    config: RunConfig
    snapshots: SnapshotStream
    clock: pd.DataFrame
    moments: Mapping[str, tuple[int, float]]


@dataclass(frozen=True)
class LoggedTracker:
    """Hands out the tracks of a log, whatever it is shown."""

    tracks: Mapping[float, Tracks]

    def step(self, scan: Scan) -> Tracks:
        """Return the tracks that the log has at the scan's time."""
        return self.tracks.get(round(scan.time_s, 6), Tracks.none())


def score_logs(
    logs: Logs, out: Path | None, force: bool, command: str, draw: Callable[[Path], object] = str
) -> tuple[Path, dict[str, Any], str, bool]:
    """Score a log and leave a run's folder, or nothing.

    Args:
        out: The folder to write; None for a name in ``results/``.
        draw: Draws a folder's page.

    Returns:
        The folder, the metrics, what was scored in words, and whether the log has tracks and none was left out.

    Raises:
        InputError: A file is missing, of no known format, broken, or the files do not belong together.
    """
    begin = perf_counter()
    files = {TRUTH: logs["truth"], TRACKS: logs["tracks"], DETECTIONS: logs["detections"]}
    read = (_log(logs, role, path) for role, path in files.items() if path is not None)
    if logs["step"] is not None and not any(map(_is_counted, read)):
        raise InputError("`step`: the files have times of their own, so that no frame is only counted; leave it out")
    name = logs["name"] or logs["tracks"].name.partition(".")[0]
    against = _of_run(logs, name) if runfolder.is_run_folder(logs["truth"]) else _of_files(logs, name)
    rows = _rows(_log(logs, TRACKS, logs["tracks"]))
    place, named, stated = f"`tracks`: {logs['tracks']}", rows["id"].tolist(), {"existence": Numbers(0.0, 1.0)}
    check_numbers(place, rows, stated, lambda row: f"row {row + 1}, track {named[row]}", "mend it or drop the column")
    tracks, report, is_whole = _tracks_at(rows, against)
    config, snapshots = against.config.tracked_by(lambda *_: LoggedTracker(tracks)), against.snapshots
    pending = runfolder.open_folder(out, config.default_folder_name(), force)
    try:
        evaluation = evaluation_of(config, snapshots)
        evaluation.follow()
        evaluated = evaluation.finish()
        check_scored(evaluated.scores, evaluated.steps, "truth")
        metrics = evaluated.metrics(config, snapshots.about, perf_counter() - begin)
        if not (set(STDS) <= set(rows) and np.isfinite(rows[[*STDS]]).all(axis=None)):
            # Those that stand in for them say nothing of the tracker.
            metrics |= _unknown(metrics, ("crps", "ellipse90")) | {"calibration": _unknown(metrics["calibration"])}
            report += "; it does not tell all deviations, so calibration, CRPS and ellipses are null"
        if "existence" not in rows or rows["existence"].isna().any():
            # Nor does the certainty that stands in for it.
            metrics |= {"existence_calibration": _unknown(metrics["existence_calibration"])}
        if by_rules := _by_nuscenes_rules(logs):
            metrics["nuscenes"] = by_rules
            report += "; by nuScenes' rules AMOTA is {amota:.3f} and AMOTP {amotp:.3f} m".format(**by_rules)
        write_run(pending.path, evaluated, metrics, config, command, snapshots.hashes(), is_log=True)
        with trusted():
            draw(pending.path)
        with signals_held(forgotten=True):
            return pending.finish(), metrics, report, is_whole
    except BaseException:
        pending.discard()
        raise


def _by_nuscenes_rules(logs: Logs) -> dict[str, Any] | None:
    """Return what ``nuscenes_scores`` does of truth and tracks in nuScenes' JSON; None of other files."""
    pair = logs["truth"], logs["tracks"]
    if any((logs["format"] or path.suffix.lstrip(".")) not in ("nuscenes", "json") for path in pair):
        return None
    log = _log(logs, TRUTH, logs["truth"])
    return nuscenes_scores(*pair, _poses(log), log.step_s)


def _unknown(table: Mapping[str, Any], words: Sequence[str] = ("",)) -> dict[str, Any]:
    """Return metrics with null for those that have one of the words in their names."""
    nulled = {name: None if any(word in name for word in words) else value for name, value in table.items()}
    return nulled | {name: _unknown(value, words) for name, value in table.items() if isinstance(value, Mapping)}


def _log(logs: Logs, role: str, path: Path) -> LogFile:
    ego = Path(logs["ego"]) if logs["ego"] is not None and Path(logs["ego"]).exists() else None
    path = path / f"{role}.parquet" if runfolder.is_run_folder(path) else path
    return LogFile(path, role, logs["format"], logs["step"] or LogFile.step_s, ego)


def _poses(log: LogFile) -> pd.DataFrame | None:
    """Return the table of the sensor's poses; None without one, and of KITTI's poses, which go with the reading."""
    if log.ego is None or log.ego.suffix == ".txt" or log.ego.is_dir():
        return None
    rows = _typed(f"`ego`: {log.ego}", read_poses_table(log.ego, log.step_s))
    if "time_s" not in rows:
        raise InputError(f"`ego`: {log.ego} lacks the column time_s; add the time of each sample")
    return rows


def _is_counted(log: LogFile) -> bool:
    """Return whether a log's times are numbers of frames, or of samples of which no poses tell the times."""
    kind = log.format or split_topic(log.path)[0].suffix.lower().lstrip(".")
    if kind not in ("csv", "parquet", "mcap"):
        poses = _poses(log) if kind in ("nuscenes", "json") else None
        return poses is None or "sample_token" not in poses
    rows = log.read()
    return {"step", "time_s"} <= set(rows) and np.array_equal(rows["time_s"], rows["step"] * log.step_s)


def _rows(log: LogFile) -> pd.DataFrame:
    return _typed(f"`{log.role}`: {log.path}", log.read(), is_named=log.role != DETECTIONS)


def _typed(place: str, rows: pd.DataFrame, is_named: bool = False) -> pd.DataFrame:
    """Return rows with numbers in each column that has a unit in its name, and whole ones that count."""
    for column in (name for name in rows if NUMBERS.search(str(name))):
        try:
            rows[column] = rows[column].astype(np.float64)
        except (ValueError, TypeError) as error:
            raise InputError(f"{place}: the column {column} holds no number: {error}") from None
    identity = rows.reindex(columns=["id"], fill_value="?")["id"]
    if missing := int((identity.isna() | (identity == "") & is_named).sum()):
        raise InputError(f"{place}: {missing} rows have no identity; name it, or remove them")
    for column in rows.columns.intersection(["id", "episode"]):
        if column == "episode" or pd.api.types.is_float_dtype(rows[column]):
            values = pd.to_numeric(rows[column], errors="coerce")
            if len(odd := rows.loc[~(values % 1 == 0) | (values.abs() > 2**53), column]):
                raise InputError(f"{place}: {str(odd.iloc[0])[:40]} is no whole number, as {column} must be; mend it")
            rows[column] = values.astype(np.int64)
    return rows


def _of_run(logs: Logs, name: str) -> Scored:
    """Return what is scored against the truth and the detections of a run's folder."""
    for option in ("detections", "ego", "sensor", "seed"):
        if logs[option] is not None:
            raise InputError(f"`{option}`: it is taken from the run's folder {logs['truth']}; leave it out")
    if "tracker" in merged(None, {}, logs["settings"] or []):
        raise InputError("`settings`: tracker does not concern a log, whose tracker ran elsewhere; leave it out")
    config = resolve_run_config(options={"replay": str(logs["truth"])}, settings=logs["settings"] or [])
    config = config.model_copy(update={"tracker": TrackerConfig(name=name)})
    truth = runfolder.read_table(logs["truth"], runfolder.TRUTH, TRUTH)
    clock = truth.drop_duplicates("step")[["step", *complete.KEYS]]
    return Scored(config, read_snapshots(logs["truth"], config), clock.assign(own=clock["time_s"]), {})


def _of_files(logs: Logs, name: str) -> Scored:
    """Return what is scored against files."""
    source = _log(logs, TRUTH, logs["truth"])
    rows = _rows(source)
    road_file = logs["truth"].parent / runfolder.ROAD
    has_road = road_file.is_file() and "sample_token" not in rows
    road = read_road(road_file, TRUTH) if has_road else LaneGraphRoad(graph=without_map())
    ego = _poses(source)
    moments = complete.sample_times(rows, ego, source.step_s)
    rows = complete.with_times(rows, moments)
    rows = complete.with_ego(rows, ego, logs["ego"], logs["truth"])
    complete.check_scene(f"`truth`: {logs['truth']}", rows)
    settings = merged(None, {}, logs["settings"] or [])
    sensor = ({"profile": logs["sensor"]} if logs["sensor"] else {}) | settings.pop("sensor", {})
    if settings:
        raise InputError(f"`settings`: {next(iter(settings))} does not concern a log; only sensor.KEY=VALUE does")
    recording = RecordingConfig(format=source.format or logs["truth"].suffix.lstrip(".") or "folder", ego=EGO)
    traffic = TrafficConfig(net=ROAD_OF_RECORDING, recording=recording)
    base = RunConfig(
        seed=logs["seed"] or 0, replay=str(logs["truth"].resolve()), traffic=traffic, tracker=TrackerConfig(name=name)
    )
    config = config_from_table(base.as_table() | {"sensor": sensor})
    figures = sensor_settings(config.sensor.profile, config.sensor.overrides)
    truth, clock = complete.truth_table(rows, road, figures)
    given = logs["detections"]
    found = None if given is None else complete.with_times(_rows(_log(logs, DETECTIONS, given)), moments)
    try:
        snapshots = snapshots_of(truth, complete.detection_table(found, truth, clock), road, figures)
    except ValueError as error:
        raise InputError(f"`truth`: {logs['truth']}: {error}; mend the file") from None
    files = {f"truth/{path.name}": path for path in (logs["truth"], given) if path is not None and path.is_file()}
    return Scored(config, replace(snapshots, files=files), clock, moments)


def _tracks_at(rows: pd.DataFrame, against: Scored) -> tuple[dict[float, Tracks], str, bool]:
    """Return the tracks of each time, how many there are in words, and whether there are some and none was left out."""
    clock = against.clock
    rows = complete.with_times(rows, against.moments)
    placed = complete.on_clock(rows, clock, TRACKS)
    placed = placed.loc[placed.sort_values("off", kind="stable").drop_duplicates(["step", "id"]).index.sort_values()]
    if len(placed) < LEAST_PLACED * len(rows):
        found = f"{len(placed)} of the log's {len(rows)} rows are at a time of the truth"
        raise InputError(f"`tracks`: {found}; are both on one clock, in seconds?")
    left_out = len(rows) - len(placed)
    placed = placed.reset_index(drop=True)
    if not pd.api.types.is_integer_dtype(placed["id"]):
        placed["id"] = pd.factorize(placed["id"].astype(str), sort=True)[0]
    count = len(placed)
    if "speed_mps" not in placed:
        lon_speed, lat_speed = (complete.slope_of(placed, name) for name in ("lon_m", "lat_m"))
        if against.snapshots.road.has_headings:
            lon_speed, lat_speed = np.hypot(lon_speed, lat_speed), np.zeros(count)
        placed["speed_mps"], placed["lat_speed_mps"] = lon_speed, lat_speed
    if "accel_mps2" not in placed:
        placed["accel_mps2"] = complete.slope_of(placed, "speed_mps")
    usual = {"lat_speed_mps": 0.0, "existence": 1.0, **dict.fromkeys(STDS, 1.0)}
    for name, value in usual.items():
        placed[name] = complete.filled(placed, name, value)
    codes = {word: code for code, word in enumerate(TRACK_STATES)} | {"": CONFIRMED}
    words = placed.reindex(columns=["state"], fill_value="")["state"].fillna("").astype(str)
    if odd := sorted(set(words) - set(codes)):
        there = f"there are {', '.join(TRACK_STATES)}; rename it, or drop the column"
        raise InputError(f"`tracks`: state holds {shown(odd[0])}; {there}")
    placed["state"] = words.map(codes).astype(np.int8)
    placed["track_id"] = placed["id"].astype(np.int64)
    columns = {column: placed[column].to_numpy() for column in Tracks.__dataclass_fields__}
    times = np.round(placed["time_s"].to_numpy(dtype=np.float64), 6)
    tracks = {}
    for time_s in np.unique(times):
        own = times == time_s
        told = tracks[float(time_s)] = Tracks(**{name: values[own] for name, values in columns.items()})
        if fault := fault_of(told):
            raise InputError(f"`tracks`: at {time_s:g} s it can't be scored: {fault}; mend the log")
    beside = f"; left out: {left_out} at no time of the truth, or twice there" if left_out else ""
    report = f"{len(placed)} rows of tracks at {len(tracks)} of {len(clock)} steps{beside}"
    return tracks, report, 0 < len(rows) == len(placed)
