"""The whole measurement: trackers against the number of vehicles in range, then the mixtures."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.bench.measure import Contender, as_row, time_in_turns, warm_up
from harness.bench.mixtures import time_mixtures
from harness.bench.scene import bench_scene
from harness.errors import InputError
from mmpf.registry import UnknownNameError

VEHICLES = (10, 25, 50, 100, 200)
STEPS = 40
SLOPE_FROM = 25
COARSE = "coarse"
STONE_SOUP = ("stonesoup-gnn", "stonesoup-jpda", "stonesoup-particle")
DEFAULT_TRACKERS = ("mmpf:gmm", "mmpf:cvm", *STONE_SOUP, *(f"{name}:{COARSE}" for name in STONE_SOUP[:2]))


@dataclass(frozen=True)
class BenchPlan:
    """What is measured.

    Attributes:
        vehicles: Numbers of vehicles in range, ascending.
        trackers: Trackers by name, those of this project with their motion model (``mmpf:gmm``), Stone Soup's with
            ``:coarse`` for the gate that spares them distances to far detections.
        particles: Particles per vehicle of this project's tracker.
        steps: Scans of each scene.
        seed: Root of all randomness.
        budget_s: Processor time that each tracker has for each number of vehicles; a slower one drops out.
    """

    vehicles: tuple[int, ...] = VEHICLES
    trackers: tuple[str, ...] = ()
    particles: int = 1000
    steps: int = STEPS
    seed: int = 0
    budget_s: float = 10.0

    @property
    def contenders(self) -> list[Contender]:
        """The trackers with their options, Stone Soup's left out of the default where it is not installed."""
        names = self.trackers or tuple(
            name
            for name in DEFAULT_TRACKERS
            if not name.startswith("stonesoup") or importlib.util.find_spec("stonesoup") is not None
        )
        return [contender_of(name, self.particles) for name in names]


def contender_of(name: str, particles: int) -> Contender:
    """Return the tracker that a name of ``trackers`` stands for.

    Raises:
        InputError: The part behind the colon means nothing for this tracker.
    """
    tracker, _, variant = name.partition(":")
    if tracker == "mmpf":
        model = variant or "gmm"
        return Contender("mmpf", tracker, {"model": model, "particles": particles}, model, particles)
    if tracker.startswith("stonesoup"):
        if variant not in ("", COARSE):
            raise InputError(f"`trackers` {name}: give {tracker} as it ships, or {tracker}:{COARSE}")
        own = 300 if tracker == "stonesoup-particle" else None
        return Contender(name, tracker, {"coarse_gate": True} if variant else {}, None, own)
    return Contender(name, name)


def run_bench(plan: BenchPlan, advance: Callable[[], None]) -> dict[str, Any]:
    """Measure everything.

    Args:
        plan: What is measured.
        advance: Called after each scan of each scene.

    Returns:
        ``rows``, ``gmm`` and ``slopes`` as plain values.

    Raises:
        InputError: There is no such tracker or model, or it is none that can be timed.
    """
    contenders = plan.contenders
    try:
        warm_up(contenders, bench_scene(min(plan.vehicles), plan.steps, np.random.default_rng(plan.seed)))
    except (UnknownNameError, TypeError) as error:
        raise InputError(f"`trackers`: {error}") from None
    rows: list[dict[str, Any]] = []
    for vehicles in plan.vehicles:
        scene = bench_scene(vehicles, plan.steps, np.random.default_rng([plan.seed, vehicles]))
        rows += [as_row(stepping, vehicles) for stepping in time_in_turns(contenders, scene, plan.budget_s, advance)]
    return {"rows": rows, "gmm": time_mixtures(np.random.default_rng(plan.seed)), "slopes": slopes(rows)}


def slopes(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the slope of each tracker's line in the log-log plot from 25 vehicles on, by least squares.

    ``slope`` is that of the median wall time, ``slope_cpu`` that of the processor time, which a busy machine spoils
    less.
    """
    lines: dict[tuple[str, str | None], list[dict[str, Any]]] = {}
    for row in rows:
        if row["vehicles"] >= SLOPE_FROM and row["ms_p50"]:
            lines.setdefault((row["tracker"], row["model"]), []).append(row)
    return [
        {
            "tracker": tracker,
            "model": model,
            "from": line[0]["vehicles"],
            "to": line[-1]["vehicles"],
            "slope": _slope(line, "ms_p50"),
            "slope_cpu": _slope(line, "cpu_ms_p50"),
        }
        for (tracker, model), line in lines.items()
        if len(line) >= 2
    ]


def _slope(line: Sequence[dict[str, Any]], key: str) -> float:
    vehicles, ms = (np.log([row[name] for row in line]) for name in ("vehicles", key))
    return float(np.polyfit(vehicles, ms, 1)[0])
