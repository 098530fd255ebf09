"""Fits speeds at bends and junctions to simulated traffic: medians over free drivers."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import cast

import numpy as np

from harness.common.errors import InputError
from harness.common.files import write_text
from harness.lab.fit.card import TRAFFIC, write_card
from harness.lab.windows.onmap import OnMap, on_map
from harness.lab.windows.recording import first_to_last, joined_apart, load_all, record_traffic, traffic_version
from harness.truth.network.network import Network
from mmpf.map.control import YIELD
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.motion.turning import TurningDriver, lane_speeds, road_speeds
from mmpf.numerics.arrays import BoolArray, FloatArray, taken

ON_NETWORKS = "junction,priority,roundabout"
TURNING = "turning"
DURATION_S = 100.0

TURN_PER_M = 0.01
INTO_TURN_M, TURNS_FASTER_MPS = 3.0, 3.0
# Who comes to a slower lane, and is slow before it for no other reason.
SLOWER_BY_MPS, SLOWING_WITHIN_M, BRAKES_MPS2, STOPS_BELOW = 2.0, (5.0, 40.0), 0.3, 0.5
BEFORE_LINE_M, AT_LINE_M, STANDS_MPS = 15.0, 2.0, 1.0
# Who has just set out and is far below what the road lets it go.
SETS_OUT_MPS, FAR_BELOW_MPS = (2.0, 6.0), 4.0
# Who drives at its pace.
STEADY_MPS2, DRIVES_MPS, AWAY_FROM_LINES_M = 0.15, 5.0, 60.0
FEWEST = 30
# Of a normal distribution, against the median absolute deviation.
STD_PER_ABSOLUTE_DEVIATION = 1.4826


Say = Callable[[str], None]


@dataclass(frozen=True)
class DrivenMap:
    """The lanes of one map, and moments of the vehicles on them whom no leader holds."""

    graph: LaneGraph
    moments: OnMap


def train_turning(networks: Sequence[Network], seeds: range, cache: Path | None, out: Path, say: Say) -> Path:
    """Record traffic on networks, fit how its drivers drive by the map, and write it with a card; return the file.

    Args:
        networks: Networks in the plane; each is recorded with every seed at each of its named demands.

    Raises:
        InputError: A network has one main road in place of a map, or there is too little traffic.
    """
    for network in networks:
        if network.plane is None or not network.demands:
            raise InputError(f"`net` {network.name}: give networks in the plane with demands, such as {ON_NETWORKS}")
    maps = [_recorded(network, seeds, cache, say) for network in networks]
    out.mkdir(parents=True, exist_ok=True)
    names = ",".join(network.name for network in networks)
    facts = {
        "Command": f"`python -m harness train --case turning --net {names} --seeds {seeds.start}:{seeds.stop}`",
        TRAFFIC: ", ".join(map(traffic_version, networks)),
        "Data": f"SUMO, of each seed {DURATION_S:g} s at each of the networks' demands",
        "Seeds": first_to_last(seeds),
        "Moments": f"{sum(len(one.moments) for one in maps)} of drivers whom no leader holds",
    }
    driver, path = fit_turning(maps), out / "turning.toml"
    lines = [f"{field.name} = {value:.4g}" for field, value in zip(fields(driver), astuple(driver), strict=True)]
    write_text(path, "\n".join(["# How drivers drive by the map, fitted to the training recordings.", *lines, ""]))
    write_card(path.with_suffix(".md"), TITLE, facts, [], LIMITS)
    return path


def _recorded(network: Network, seeds: range, cache: Path | None, say: Say) -> DrivenMap:
    demands = [network.demand_files[name].density_veh_per_km_lane for name in network.demands]
    files = record_traffic(network, seeds, DURATION_S, cache, say, demands)
    graph = cast("LaneGraph", network.road.graph)
    laid = [on_map(recording, graph) for recording in load_all(files)]
    return DrivenMap(graph, joined_apart([taken(one, one.free) for one in laid], "driver"))


def fit_turning(maps: list[DrivenMap]) -> TurningDriver:
    """Fit how drivers drive by the map.

    Raises:
        InputError: Too few drivers did one of these things.
    """
    turning = _median("in turns", [_lateral_mps2(one) for one in maps])
    looking = _median("before lines where others have right of way", [_at_lines_mps(one) for one in maps])
    sketch = TurningDriver(turning, 1.0, looking, np.inf, 1.0, 0.0)
    slowing = _median("before slower lanes", [_slowing_mps2(one, sketch) for one in maps])
    sketch = TurningDriver(turning, slowing, looking, np.inf, 1.0, 0.0)
    strongest = _median("setting out", [_setting_out_mps2(one, sketch) for one in maps])
    paces = np.concatenate([_paces(one, sketch) for one in maps])
    pace = _median("at their pace", [paces])
    spread = STD_PER_ABSOLUTE_DEVIATION * float(np.median(np.abs(paces - pace)))
    return TurningDriver(turning, slowing, looking, strongest, pace, spread)


def _median(what: str, values: list[FloatArray]) -> float:
    joined = np.concatenate(values)
    if len(joined) < FEWEST:
        raise InputError(f"`seeds`: {len(joined)} moments of drivers {what} are too few to train on; give more seeds")
    return float(np.median(joined))


def _lateral_mps2(driven: DrivenMap) -> FloatArray:
    moments, bend = driven.moments, driven.graph.curvature_per_m[driven.moments.lane]
    turns = driven.graph.in_junction[moments.lane] & (bend > TURN_PER_M) & (moments.along_m > INTO_TURN_M)
    turns &= moments.speed_mps > TURNS_FASTER_MPS
    return np.asarray((moments.speed_mps**2 * bend)[turns])


def _at_lines_mps(driven: DrivenMap) -> FloatArray:
    """Return the speed at a line of those who did not have to stop before it, (stays,)."""
    moments = driven.moments
    before = taken(moments, _gives_way(driven) & (moments.to_end_m < BEFORE_LINE_M))
    _, some, stay = np.unique(before.driver * len(driven.graph) + before.lane, return_index=True, return_inverse=True)
    slowest, nearest = np.full(len(some), np.inf), np.full(len(some), np.inf)
    np.minimum.at(slowest, stay, before.speed_mps)
    np.minimum.at(nearest, stay, before.to_end_m)
    return np.asarray(before.leaves_at_mps[some[(slowest > STANDS_MPS) & (nearest < AT_LINE_M)]])


def _gives_way(driven: DrivenMap) -> BoolArray:
    graph, moments = driven.graph, driven.moments
    if graph.control is None:
        return np.zeros(len(moments), dtype=np.bool_)
    links = zip(graph.link_from.tolist(), graph.successor.tolist(), strict=True)
    held = {link for link, kind in zip(links, graph.control.kind.tolist(), strict=True) if kind == YIELD}
    return np.array([pair in held for pair in zip(moments.lane.tolist(), moments.following.tolist(), strict=True)])


def _slowing_mps2(driven: DrivenMap, driver: TurningDriver) -> FloatArray:
    moments, speed = driven.moments, lane_speeds(driven.graph, driver)
    ahead = speed[moments.following]
    comes = (moments.following != NOWHERE) & (ahead < speed[moments.lane] - SLOWER_BY_MPS) & ~_gives_way(driven)
    low, high = SLOWING_WITHIN_M
    comes &= (moments.to_end_m > low) & (moments.to_end_m < high) & (moments.accel_mps2 < -BRAKES_MPS2)
    comes &= (moments.leaves_at_mps > STOPS_BELOW * ahead) & (moments.speed_mps > ahead)
    return np.asarray(((moments.speed_mps**2 - ahead**2) / (2.0 * moments.to_end_m))[comes])


def _setting_out_mps2(driven: DrivenMap, driver: TurningDriver) -> FloatArray:
    moments, allowed = driven.moments, _allowed(driven, driver)
    low, high = SETS_OUT_MPS
    sets_out = (moments.speed_mps > low) & (moments.speed_mps < high) & (moments.accel_mps2 > BRAKES_MPS2)
    return moments.accel_mps2[sets_out & (allowed > moments.speed_mps + FAR_BELOW_MPS)]


def _paces(driven: DrivenMap, driver: TurningDriver) -> FloatArray:
    """Return each driver's mean speed against what the road lets it go where it holds its speed, (drivers,)."""
    moments = driven.moments
    steady = (np.abs(moments.accel_mps2) < STEADY_MPS2) & (moments.speed_mps > DRIVES_MPS)
    steady &= moments.to_end_m > AWAY_FROM_LINES_M
    share = moments.speed_mps[steady] / _allowed(driven, driver)[steady]
    _, driver_of = np.unique(moments.driver[steady], return_inverse=True)
    return np.asarray(np.bincount(driver_of, share) / np.bincount(driver_of))


def _allowed(driven: DrivenMap, driver: TurningDriver) -> FloatArray:
    moments = driven.moments
    return road_speeds(driven.graph, moments.lane, moments.following, moments.along_m, driver)


TITLE = "Driving by the map (`turning`, of the learned driver on networks)"
LIMITS = (
    "Fitted to SUMO's drivers, whose speeds in turns and before lines are milder and more alike than people's.",
    "One number each for all drivers, but for the pace; medians over moments, so that slow drivers count more.",
    "Half of a vehicle's particles desire what the road lets them go; the share was chosen by the continuous ranked "
    "probability score of rollouts of 5 s on the training traffic (0.3 to 0.5 were best).",
)
