"""Opens what a configuration names: live or recorded snapshots, the tracker, and the map that trackers are given."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.config.altered import AlteredSettings
from harness.config.layers import config_from_table
from harness.config.model import BeliefsConfig, RecordingConfig, RunConfig, TrafficConfig
from harness.decisions.decide import driver_of
from harness.running.follow import TrackerBuilder
from harness.running.replay import RECORDED, read_snapshots, snapshots_of_bag
from harness.running.resolve import import_metrics
from harness.running.snapshots import RandomStreams, SnapshotStream, observe_traffic
from harness.sensor.altered import altered
from harness.sensor.detector import build_sensor, data_sheet
from harness.sensor.given import GivenDetections
from harness.sensor.observation import Sensor
from harness.sensor.profiles import sensor_settings
from harness.storage import run_folder as runfolder
from harness.trackers.catalogue import build_tracker
from harness.trackers.protocol import AnyTracker, TrackerSetting
from harness.truth.frame import TruthSource
from harness.truth.network.network import Network, load_network
from harness.truth.recorded import formats
from harness.truth.recorded.detected.source import open_drives
from harness.truth.recorded.source import open_recorded_traffic
from harness.truth.sumo.plane_traffic import BEYOND_RANGE_M, REACH_M
from harness.truth.sumo.simulation import open_traffic
from harness.truth.sumo.window import check_window
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Lane, Road
from mmpf.registry import UnknownNameError

MOST_UNUSUAL = 3
OpenSnapshots = Callable[[RunConfig], SnapshotStream]


def simulate(network: Network, traffic: TrafficConfig, seed: int, reach_m: float, gui: bool = False) -> TruthSource:
    """Start a simulation; see ``harness.truth.sumo.simulation.open_traffic``."""
    return open_traffic(
        network,
        reach_m=reach_m,
        demand=traffic.density if traffic.demand is None else traffic.demand,
        duration_s=traffic.duration_s,
        seed=RandomStreams.from_seed(seed).truth,
        gui=gui,
        broken_down=traffic.broken_down,
    )


Simulate = Callable[[Network, TrafficConfig, int, float], TruthSource]


def open_snapshots(config: RunConfig, simulate: Simulate = simulate, *, ahead: bool = False) -> SnapshotStream:
    """Open the snapshots that the configuration describes; ``ahead`` simulates on a second core while they are tracked.

    Raises:
        InputError: There is no such network, demand, sensor or recording, or it is broken; or no window can be opened.
    """
    if config.replay is None:
        simulated = _altered(_simulated(config, simulate), config)
        return simulated.made_ahead() if ahead else simulated
    path = Path(config.replay)
    if not runfolder.is_run_folder(path):
        return _altered(_recorded(path, config), config)
    snapshots = read_snapshots(path, config)
    # A run's detections are recorded as they were changed then.
    before = config_from_table(runfolder.read_config_table(path, "replay")).altered
    return snapshots if before == config.altered else _altered(snapshots, config)


def _altered(snapshots: SnapshotStream, config: RunConfig) -> SnapshotStream:
    """Return the snapshots with their detections changed as the configuration says."""
    if (settings := config.altered) == AlteredSettings():
        return snapshots
    sensor = sensor_settings(config.sensor.profile, config.sensor.overrides)
    every = settings.every_scan
    return replace(
        snapshots,
        step_s=every * snapshots.step_s,
        expected_steps=-(-snapshots.expected_steps // every),
        stream=altered(
            snapshots.stream, settings, sensor, snapshots.road, RandomStreams.from_seed(config.seed).altered
        ),
    )


def _recorded(path: Path, config: RunConfig) -> SnapshotStream:
    traffic, recording = config.traffic, config.traffic.recording
    if recording is None:
        raise InputError(f"`replay`: {path} is not a run's folder, and no format of recorded traffic is set")
    if recording.map:
        formats.check_map(recording.format)
    if formats.brings_detections(recording.format):
        return _given(path, config, recording)
    if recording.least_score is not None:
        raise InputError(
            f"`settings` traffic.recording.least_score: {recording.format} has no detections; leave it out"
        )
    if recording.format == formats.BAG:
        return snapshots_of_bag(path, config)
    sensor = _sensor(config)
    truth = open_recorded_traffic(
        path, recording.format, traffic.net, recording.ego, traffic.duration_s, recording.start_s
    )
    return replace(
        observe_traffic(truth, sensor, config.seed),
        files=input_files(config),
        report=truth.report(),
        about={"recording": truth.summary()},
    )


def _given(path: Path, config: RunConfig, recording: RecordingConfig) -> SnapshotStream:
    """Return snapshots of drives whose detections are on record."""
    settings = sensor_settings(config.sensor.profile, config.sensor.overrides)
    drives = formats.read_drives(path, recording.format, recording.map)
    least_score = formats.least_score_of(recording.format, recording.least_score)
    truth = open_drives(path, recording.format, drives, config.traffic.duration_s, recording.start_s, least_score)
    return replace(
        observe_traffic(truth, GivenDetections(settings, truth, formats.FORMATS[recording.format].scores), config.seed),
        files=input_files(config),
        report=truth.report(),
        about={"recording": truth.summary()},
    )


def _simulated(config: RunConfig, simulate: Simulate) -> SnapshotStream:
    # The sensor is checked first: it costs nothing, while opening traffic starts a simulation.
    sensor = _sensor(config)

    traffic = config.traffic
    network = load_network(traffic.net)
    if network.configuration is not None and traffic.density is not None:
        raise InputError(f"`density`: {network.name} brings its own demand; leave `density` out")
    reach_m = max(REACH_M, sensor.model().range_m + BEYOND_RANGE_M)
    truth = simulate(network, traffic, config.seed, reach_m)
    left_out = network.sumo_inputs.left_out
    told = [f"left out of {network.name}: {', '.join(left_out)}"] * bool(left_out)
    more = [f"and {len(network.unusual) - MOST_UNUSUAL} more"] * (len(network.unusual) > MOST_UNUSUAL)
    unusual = "; ".join([*network.unusual[:MOST_UNUSUAL], *more])
    told += [f"unusual in {network.name}: {unusual}"] * bool(network.unusual)
    files = _files_of_network(network)
    return replace(observe_traffic(truth, sensor, config.seed), files=files, report="; ".join(told))


def _files_of_network(network: Network) -> dict[str, Path]:
    own = network.configuration or network.net_file.parent / "network.toml"
    read = dict.fromkeys(file for file in (*network.files, network.calibration_file, own) if file is not None)
    return by_name("network", (file for file in read if file.is_file()))


def input_files(config: RunConfig) -> dict[str, Path]:
    """Return the files that decide a configuration's traffic and detections, as its snapshots name them.

    Raises:
        InputError: There is no such network, or its files are malformed.
    """
    if config.replay is None:
        return _files_of_network(load_network(config.traffic.net))
    path, recording = Path(config.replay), config.traffic.recording
    if runfolder.is_run_folder(path) or recording is None:
        return {f"replay/{name}": path / name for name in RECORDED if (path / name).is_file()}
    if recording.format == formats.BAG:
        return {f"replay/{path.name}": path}
    files = formats.files_of(path, recording.format)
    if formats.brings_detections(recording.format):
        return {f"replay/{file.parent.name}/{file.name}": file for file in files}
    return by_name("replay", files)


def by_name(place: str, files: Iterable[Path]) -> dict[str, Path]:
    """Return files by their names below a place; of two of one name the later ones are numbered."""
    found: dict[str, Path] = {}
    for file in files:
        name = f"{place}/{file.name}"
        found[name if name not in found else f"{name}-{len(found)}"] = file
    return found


def _sensor(config: RunConfig) -> Sensor:
    return build_sensor(sensor_settings(config.sensor.profile, config.sensor.overrides))


def check_gui(config: RunConfig) -> None:
    """Check that there is traffic to be shown, and a window to show it in."""
    if config.replay is not None:
        raise InputError(
            "`gui`: `replay` uses recorded traffic, so no SUMO runs and there is nothing to open; leave it out"
        )
    check_window()


def check_named_code(config: RunConfig) -> None:
    """Use what is named once as a check, so that a wrong name or option is reported before traffic is simulated."""
    import_metrics(config)
    settings = sensor_settings(config.sensor.profile, config.sensor.overrides)
    try:
        sensor = replace(data_sheet(settings), **config.tracker.believes.sheet())
    except ValueError as error:
        raise InputError(f"`settings` tracker.believes: {error}") from None
    tracker_builder(config)(TrackerSetting(road=highway(), sensor=sensor, rng=np.random.default_rng(0)))
    driver_of(config.decisions.driver)


def as_believed(snapshots: SnapshotStream, config: RunConfig) -> SnapshotStream:
    """Return the snapshots with the information that the configuration gives the tracker."""
    believes = config.tracker.believes
    if believes.of_the_map:
        snapshots = replace(snapshots, road=believed_map(snapshots.road, believes))
    try:
        sensor = replace(snapshots.sensor, **believes.sheet())
    except ValueError as error:
        raise InputError(f"`settings` tracker.believes: {error}") from None
    factor = 1.0 if believes.noise_factor is None else believes.noise_factor
    return replace(snapshots, sensor=sensor, noise_factor=factor, tells_signals=config.tracker.knows_signals)


def tracker_builder(config: RunConfig) -> TrackerBuilder:
    """Return what builds the configuration's tracker, or raises a ``InputError`` that says what it refuses."""

    def build(setting: TrackerSetting) -> AnyTracker:
        try:
            return build_tracker(config.tracker.maker, setting, config.tracker.all_options())
        except UnknownNameError as error:
            raise InputError(f"`model`: {error}") from error.__cause__
        except (ValueError, TypeError) as error:
            raise InputError(f"`tracker` {config.tracker.name!r}: {error}") from None

    return build


def believed_map(road: Road, believes: BeliefsConfig) -> Road:
    """Return the road as trackers are given it."""
    if believes.map == "none":
        return LaneGraphRoad(without_map(), road.section_m, None, road.reference_xy, road.reference_start_m)
    missing, as_one = set(believes.lanes_left_out or ()), believes.map == "one-lane"
    if missing or as_one:
        road = _with_other_lanes(road, missing, as_one)
    return road.shifted(believes.map_shift_m) if believes.map_shift_m else road


def _with_other_lanes(road: Road, missing: set[int], as_one: bool) -> Road:
    if not isinstance(road, CorridorRoad):
        raise InputError(
            "`settings` tracker.believes: one-lane and lanes_left_out are for networks with a main road, as us101; "
            "leave them out, or set map to none"
        )
    if missing - {lane.number for lane in road.lanes}:
        known = ", ".join(sorted({str(lane.number) for lane in road.lanes}))
        raise InputError(f"`settings` tracker.believes.lanes_left_out: the road has lanes {known}; choose among them")
    lanes = tuple(lane for lane in road.lanes if lane.number not in missing)
    return replace(road, lanes=_as_one(lanes) if as_one and lanes else lanes)


def _as_one(lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Return one lane over all that go as far as any, auxiliary ones left out."""
    start, end = min(lane.start_m for lane in lanes), max(lane.end_m for lane in lanes)
    whole = [lane for lane in lanes if (lane.start_m, lane.end_m) == (start, end)] or list(lanes)
    right, left = min(lane.right_m for lane in whole), max(lane.left_m for lane in whole)
    return (Lane(1, right, left, start, end),)
