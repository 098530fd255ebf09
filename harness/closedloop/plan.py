"""Turns the user's lists into the episodes and beliefs of a closed loop: a grid whose cells are seeds.

Two episodes come from each seed's traffic, one that goes on as it would and one that is provoked. A cell is a seed's
traffic; its runs are drives by each belief.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from harness.closedloop.beliefs import TRUTH
from harness.common.errors import InputError
from harness.config.lists import MOST_SEED, names
from harness.config.model import RunConfig, TrafficConfig
from harness.config.options import setting_of, setting_words
from harness.grid.cells import Cell, GridPlan, PlannedRun
from harness.grid.grid import GridRequest, plan_grid

FREE, BRAKE, CROSS, STOPPED, DARK = "free", "brake", "cross", "stopped", "dark"
PROVOKED = (BRAKE, CROSS, STOPPED, DARK)
STREAMS = {FREE: 0, BRAKE: 1, CROSS: 3, STOPPED: 4, DARK: 5}
"""Number of each kind's own stream of random numbers; the second was that of a kind that is gone."""
KIND = "episode.kind"
AXES = (KIND,)
TRACKED_S, DRIVEN_S = 5.0, 20.0
BELIEFS_EXAMPLE = "truth,oracle-kalman,mmpf,detections"
STAND_IN = "detections"
"""Tracker of a belief that needs none: it costs next to nothing, and a kept episode has tracks to look at."""
FLOWS_MPS = (10.0, 15.0, 20.0, 25.0, 30.0)
"""Speeds of the traffic of which each seed's episodes of ``stopped`` draw one."""
FLOW_STREAM = 10
FREE_FLOW_VEH_PER_KM = 10.0
"""Density of traffic that flows at a speed of its own, where none is asked for."""
DETECTED = 0.35
"""Share of scans in which the leader of an episode ``dark`` is detected, where none is asked for."""


@dataclass(frozen=True)
class DriveRequest:
    """A closed loop as the user wrote it.

    Attributes:
        beliefs: What the ego drives by, a list.
        episodes: How many, half of them provoked.
        seed: Seed of the first two; each pair has its own.
        net: Network by name or path.
        density: Vehicles per km and lane; None with ``demand``, or for the network's default.
        demand: Named demand.
        driver: Driver by name, or module:factory.
        sensor: Sensor profile.
        provoke: Kinds of provocation, a list, in turns.
        heed_unseen: From which probability of an unseen vehicle in its way on the ego holds; None for never.
        settings: ``KEY=VALUE`` words that hold for all.
        flow: Speed at which the traffic flows, metres a second; None for one that each seed draws where a vehicle is
            to stand in the way, elsewhere for the network's.
        detected: Share of scans in which the leader of an episode ``dark`` is detected; None for the usual.
    """

    beliefs: str
    episodes: int
    seed: int = 0
    net: str = "us101"
    density: float | None = None
    demand: str | None = None
    driver: str | None = None
    sensor: str | None = None
    provoke: str = BRAKE
    heed_unseen: float | None = None
    settings: tuple[str, ...] = ()
    flow: float | None = None
    detected: float | None = None

    def as_table(self) -> dict[str, Any]:
        """Return it as plain values, with the axes by which ``compare`` distinguishes its rows."""
        table = asdict(self)
        for name in ("flow", "detected"):
            if table[name] is None:
                del table[name]
        return table | {"vary": list(AXES)}


@dataclass(frozen=True)
class PlannedDrive(PlannedRun):
    """One episode driven by one belief; ``variant`` is the belief.

    Attributes:
        kind: ``free``, or how it is provoked.
        heed_unseen: From which probability of an unseen vehicle in its way on the ego holds; None for never.
        flow_mps: Speed at which the seed's traffic flows; None for the network's.
        detected: Share of scans in which the leader of an episode ``dark`` is detected; None of others.
    """

    kind: str = FREE
    heed_unseen: float | None = None
    flow_mps: float | None = None
    detected: float | None = None

    @property
    def key(self) -> str:
        """Name of its result file."""
        told: list[object] = [self.config.as_table(), self.variant, self.kind]
        if self.heed_unseen is not None:
            told.append(self.heed_unseen)
        told += [f"{name} {value}" for name, value in (("flow", self.flow_mps), ("detected", self.detected)) if value]
        content = json.dumps(told, sort_keys=True)
        readable = f"s{self.config.seed}-{self.kind}-{self.variant}"
        readable = "".join(letter if letter.isalnum() or letter in "-." else "-" for letter in readable)[:80]
        return f"{readable}-{hashlib.sha256(content.encode()).hexdigest()[:12]}"

    def identity(self) -> dict[str, Any]:
        """Return the columns that identify this drive; ``variant`` alone names the belief."""
        tracker = None if self.variant == TRUTH else self.config.tracker.name
        own = {"tracker": tracker, "model": None, "update": None, KIND: self.kind}
        return super().identity() | own


def plan_drives(request: DriveRequest) -> GridPlan:
    """Turn what the user wrote into drives, each with a checked configuration.

    Raises:
        InputError: A list is wrong, or a name is unknown.
    """
    beliefs = names(request.beliefs, "perception", BELIEFS_EXAMPLE)
    kinds = names(request.provoke, "provoke", ",".join(PROVOKED))
    for kind in kinds:
        if kind not in PROVOKED:
            raise InputError(f"`provoke` {kind}: choose of {', '.join(PROVOKED)}")
    if request.seed + (request.episodes + 1) // 2 > MOST_SEED:
        raise InputError(f"`seed` {request.seed}: {request.episodes} episodes need more seeds than there are")
    configs, labels = _configs(request, beliefs)
    cells = []
    for pair in range((request.episodes + 1) // 2):
        provoked, seed = kinds[pair % len(kinds)], request.seed + pair
        both = (FREE, provoked)[: request.episodes - 2 * pair]
        flow_mps = _drawn_flow(seed) if request.flow is None and provoked == STOPPED else request.flow
        update = {"seed": seed} | ({} if flow_mps is None else _flowing(request, configs))
        drives = (
            PlannedDrive(
                config=config.model_copy(update=update),
                variant=label,
                kind=kind,
                heed_unseen=request.heed_unseen,
                flow_mps=flow_mps,
                detected=(request.detected or DETECTED) if kind == DARK else None,
            )
            for kind in both
            for label, config in configs.items()
        )
        cells.append(Cell(tuple(drives)))
    return GridPlan(tuple(cells), AXES, labels)


def flow_of(cell: Cell) -> float | None:
    """Return the speed at which a cell's traffic flows; None for the network's."""
    return next((run.flow_mps for run in cell.runs if isinstance(run, PlannedDrive)), None)


def _drawn_flow(seed: int) -> float:
    return float(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(FLOW_STREAM,))).choice(FLOWS_MPS))


def _flowing(request: DriveRequest, configs: Mapping[str, RunConfig]) -> dict[str, TrafficConfig]:
    """Return what is updated of each belief's configuration so that the traffic can flow: its density, if not asked."""
    asked = request.density is not None or request.demand is not None
    if asked or any(word.startswith(("traffic.density", "traffic.demand")) for word in request.settings):
        return {}
    traffic = next(iter(configs.values())).traffic
    return {"traffic": traffic.model_copy(update={"demand": None, "density": FREE_FLOW_VEH_PER_KM})}


def request_of(values: Mapping[str, Any]) -> DriveRequest:
    """Return the request that checked options describe."""
    return with_truth(
        DriveRequest(
            beliefs=values["perception"],
            episodes=values["episodes"],
            seed=values["seed"],
            net=str(values["net"] or "us101"),
            density=values["density"],
            demand=values["demand"],
            driver=values["driver"],
            sensor=values["sensor"],
            provoke=values["provoke"],
            heed_unseen=values["heed_unseen"],
            settings=(*setting_of("traffic.broken_down", values["broken_down"]), *setting_words(values["settings"])),
            flow=values["flow"],
            detected=values["detected"],
        )
    )


def with_truth(request: DriveRequest) -> DriveRequest:
    """Return the request with the truth among its beliefs: the others are held against it."""
    beliefs = [word.strip() for word in request.beliefs.split(",")]
    return request if TRUTH in beliefs else replace(request, beliefs=",".join([TRUTH, *beliefs]))


def _configs(request: DriveRequest, beliefs: tuple[str, ...]) -> tuple[Mapping[str, RunConfig], Mapping[str, str]]:
    """Return configurations by label, as a stress test on the same lists has them, and what the labels mean."""
    if any(word.strip().startswith("altered.") for word in request.settings):
        raise InputError("`settings`: altered.* is for run and stress; set sensor.* here, such as sensor.burst_share")
    trackers = dict.fromkeys(STAND_IN if belief == TRUTH else belief for belief in beliefs)
    words = [] if request.driver is None else [f"decisions.driver={request.driver}"]
    grid = GridRequest(
        net=request.net,
        densities=None if request.density is None else f"{request.density:g}",
        demands=request.demand,
        trackers=",".join(trackers),
        seeds=f"{request.seed}:{request.seed + 1}",
        duration_s=TRACKED_S + DRIVEN_S,
        sensor=request.sensor,
        settings=(*request.settings, *words),
    )
    try:
        plan = plan_grid(grid)
    except InputError as error:
        told = str(error).replace("`trackers`", "`perception`").replace("`densities`", "`density`")
        raise InputError(told) from None
    runs = dict(zip(trackers, plan.runs, strict=True))
    configs = {
        TRUTH if belief == TRUTH else runs[belief].variant: runs[STAND_IN if belief == TRUTH else belief].config
        for belief in beliefs
    }
    return configs, plan.labels
