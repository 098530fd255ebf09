"""Changes detections after the sensor made them, for live and for recorded snapshots alike.

Each alteration is a generator from snapshots to snapshots with a stream of randomness of its own, so that one leaves
the draws of the others as they were. Truth and visibility stay as they are; what the sensor knows of its own shadows
follows from the altered detections again.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from harness.config.altered import AlteredSettings
from harness.config.sensor import SensorSettings
from harness.sensor.detector import detections_from, own_shadows, rounded
from harness.sensor.memory import Chain, SensorMemory, next_state
from harness.sensor.observation import Snapshot
from harness.sensor.pseudo_occlusion import hidden_on_purpose
from harness.sensor.returns import flashing_returns, standing_returns
from harness.sensor.scene import Scene, sight_to
from harness.sensor.shadows import sensor_position
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, joined, taken
from mmpf.scan import BodyHeadings, BodySizes, Detections, Scan

UNKNOWN_DIRECTION_RAD = float(np.pi)
FADING_M = 8.0
"""Scale of the logistic curve of kept detections: 73 % are kept this much nearer than where half are."""


def altered(
    snapshots: Iterable[Snapshot],
    settings: AlteredSettings,
    sensor: SensorSettings,
    road: Road,
    stream: np.random.SeedSequence,
) -> Iterator[Snapshot]:
    """Yield snapshots as they are in the world that the settings describe."""
    thins, bursts, far, dark, adds, ego, hides = (np.random.default_rng(child) for child in stream.spawn(7))
    if settings.every_scan > 1:
        snapshots = some_scans(snapshots, settings.every_scan)
    if not settings.false_kept:
        snapshots = (_kept(snapshot, snapshot.observation.truth_id != "") for snapshot in snapshots)
    if settings.hide_s:
        snapshots = hidden_on_purpose(snapshots, settings, hides)
    if settings.kept_probability < 1.0:
        snapshots = thinned(snapshots, settings.kept_probability, thins)
    if settings.dark_share > 0.0:
        snapshots = darkened(snapshots, settings.dark_share, settings.dark_probability, dark)
    if settings.burst_share > 0.0:
        snapshots = in_bursts(snapshots, Chain(settings.burst_share, settings.burst_s), bursts)
    if settings.half_range_m is not None:
        snapshots = fading(snapshots, settings.half_range_m, road, far)
    if settings.adds:
        snapshots = with_false(snapshots, settings.of_added(sensor), road, adds)
    if settings.blind_s > 0.0:
        snapshots = blinded(snapshots, settings.blind_s, settings.blind_every_s)
    if settings.ego_std_m > 0.0 or settings.ego_std_deg > 0.0:
        snapshots = misplaced(snapshots, settings.ego_std_m, np.deg2rad(settings.ego_std_deg), road, ego)
    return (_with_shadows(snapshot, sensor, road) for snapshot in snapshots)


def some_scans(snapshots: Iterable[Snapshot], every: int) -> Iterator[Snapshot]:
    """Yield the first of every so many snapshots, their steps renumbered."""
    for k, snapshot in enumerate(snapshots):
        if k % every == 0:
            yield replace(snapshot, frame=replace(snapshot.frame, step=k // every))


def thinned(snapshots: Iterable[Snapshot], probability: float, rng: np.random.Generator) -> Iterator[Snapshot]:
    """Yield snapshots in which each detection of a vehicle is kept with a probability."""
    for snapshot in snapshots:
        false = snapshot.observation.truth_id == ""
        yield _kept(snapshot, false | (rng.random(len(false)) < probability))


def darkened(
    snapshots: Iterable[Snapshot], share: float, probability: float, rng: np.random.Generator
) -> Iterator[Snapshot]:
    """Yield snapshots in which each detection of some of the vehicles is kept with a probability.

    Vehicles are numbered as they are first detected, and every so many a one is dark, beginning at a random one: their
    share is exact up to one vehicle.
    """
    begin = float(rng.random())
    is_dark = {"": False}
    for snapshot in snapshots:
        names = snapshot.observation.truth_id
        new = np.array(sorted(set(names.tolist()) - set(is_dark)), dtype=np.str_)
        for name in rng.permutation(new).tolist():
            number = len(is_dark) - 1
            is_dark[name] = np.floor(begin + (number + 1) * share) > np.floor(begin + number * share)
        dark = np.array([is_dark[name] for name in names.tolist()], dtype=np.bool_)
        yield _kept(snapshot, ~dark | (rng.random(len(names)) < probability))


def in_bursts(snapshots: Iterable[Snapshot], chain: Chain, rng: np.random.Generator) -> Iterator[Snapshot]:
    """Yield snapshots without the detections of vehicles that are in a burst, a two-state chain for each vehicle."""
    state: dict[str, float] = {}
    time_s, episode = 0.0, -1
    for snapshot in snapshots:
        frame = snapshot.frame
        if frame.episode != episode:
            state, episode, time_s = {}, frame.episode, frame.time_s
        names = frame.vehicle_id.tolist()
        before = np.array([state.get(name, np.nan) for name in names])
        now = next_state(chain, before, frame.time_s - time_s, rng.random(len(names)))
        state, time_s = dict(zip(names, now.astype(np.float64).tolist(), strict=True)), frame.time_s
        yield _kept(
            snapshot, np.array([state.get(name, 0.0) == 0.0 for name in snapshot.observation.truth_id.tolist()], bool)
        )


def fading(snapshots: Iterable[Snapshot], half_m: float, road: Road, rng: np.random.Generator) -> Iterator[Snapshot]:
    """Yield snapshots in which detections of vehicles are lost with the distance, half of them at ``half_m``."""
    for snapshot in snapshots:
        detections, ego = snapshot.observation.scan.detections, snapshot.frame.ego_pose
        distance = sight_to(detections.lon_m, detections.lat_m, road, ego, 0.0).distance
        kept = rng.random(len(distance)) * (1.0 + np.exp((distance - half_m) / FADING_M)) < 1.0
        yield _kept(snapshot, kept | (snapshot.observation.truth_id == ""))


def blinded(snapshots: Iterable[Snapshot], blind_s: float, every_s: float) -> Iterator[Snapshot]:
    """Yield snapshots without any detection at the end of every period, counted from the first snapshot."""
    begin_s = None
    for snapshot in snapshots:
        begin_s = snapshot.frame.time_s if begin_s is None else begin_s
        # Times are multiples of the step but for their last digits.
        sees = (snapshot.frame.time_s - begin_s + 1e-6) % every_s < every_s - blind_s
        yield snapshot if sees else _kept(snapshot, np.zeros(len(snapshot.observation.truth_id), dtype=np.bool_))


def with_false(
    snapshots: Iterable[Snapshot], sensor: SensorSettings, road: Road, rng: np.random.Generator
) -> Iterator[Snapshot]:
    """Yield snapshots with the false detections of another sensor added, in an order that reveals nothing."""
    memory = SensorMemory()
    for snapshot in snapshots:
        frame, seen = snapshot.frame, snapshot.observation
        step_s = memory.begin_scan(rng, frame.episode, frame.time_s)
        sight = sight_to(frame.lon_m, frame.lat_m, road, frame.ego_pose, road.axis_of(frame.heading_rad))
        scene = Scene(sensor, frame, road, sight, seen.visible_fraction, seen.occluder, seen.in_range)
        flashes = flashing_returns(memory, scene, rng)
        values = np.concatenate([flashes.values, standing_returns(memory, scene, step_s).values])
        made = _like(detections_from(sensor, values, road), seen.scan.detections)
        detections = joined(seen.scan.detections, made)
        order = rng.permutation(len(detections))
        fraction = np.append(seen.detection_visible_fraction, np.full(len(made), np.nan))
        yield replace(
            snapshot,
            observation=replace(
                seen,
                scan=replace(seen.scan, detections=taken(detections, order)),
                truth_id=np.concatenate([seen.truth_id, np.full(len(made), "")])[order],
                detection_visible_fraction=fraction[order],
            ),
        )


def misplaced(
    snapshots: Iterable[Snapshot], std_m: float, std_rad: float, road: Road, rng: np.random.Generator
) -> Iterator[Snapshot]:
    """Yield snapshots with an error of the ego's pose, which shifts and turns all detections too."""
    for snapshot in snapshots:
        scan = snapshot.observation.scan
        along, across, turn = rng.standard_normal(3) * [std_m, std_m, std_rad]
        x, y = np.array(sensor_position(scan.ego, road))
        ego_lon, ego_lat = road.to_road(np.array([x + along]), np.array([y + across]))
        ego = replace(
            scan.ego,
            lon_m=float(ego_lon[0]),
            lat_m=float(ego_lat[0]),
            heading_rad=scan.ego.heading_rad + float(turn),
        )
        detections = scan.detections
        at_x, at_y = road.to_cartesian(detections.lon_m, detections.lat_m)
        cosine, sine = np.cos(turn), np.sin(turn)
        from_x, from_y = at_x - x, at_y - y
        lon, lat = road.to_road(
            x + along + cosine * from_x - sine * from_y, y + across + sine * from_x + cosine * from_y
        )
        headings = detections.headings
        if headings is not None:
            headings = replace(headings, heading_rad=headings.heading_rad + turn)
        detections = replace(detections, lon_m=rounded(lon), lat_m=rounded(lat), headings=headings)
        yield _with_scan(snapshot, replace(scan, ego=ego, detections=detections))


def _kept(snapshot: Snapshot, keep: BoolArray) -> Snapshot:
    return replace(snapshot, observation=snapshot.observation.with_detections(np.flatnonzero(keep)))


def _like(made: Detections, others: Detections) -> Detections:
    """Return detections with the columns that others have; an unmeasured heading gets a full circle of uncertainty."""
    zeros = np.zeros(len(made))
    unknown: dict[str, Any] = {
        "sizes": BodySizes(zeros + NOMINAL_LENGTH_M, zeros + NOMINAL_WIDTH_M, zeros + 0.5, zeros + 0.2),
        "headings": BodyHeadings(zeros, zeros + UNKNOWN_DIRECTION_RAD, zeros + 0.5),
        "correlation": zeros,
        "score": zeros + 0.5,
        "vehicle_class": np.zeros(len(made), dtype=np.int64),
    }
    for name, values in unknown.items():
        own = getattr(made, name)
        unknown[name] = None if getattr(others, name) is None else values if own is None else own
    return replace(made, **unknown)


def _with_scan(snapshot: Snapshot, scan: Scan) -> Snapshot:
    return replace(snapshot, observation=replace(snapshot.observation, scan=scan))


def _with_shadows(snapshot: Snapshot, sensor: SensorSettings, road: Road) -> Snapshot:
    """Return a snapshot whose sensor knows the shadows of the remaining detections."""
    scan = snapshot.observation.scan
    return _with_scan(snapshot, replace(scan, free_space=own_shadows(sensor, scan.detections, scan.ego, road)))
