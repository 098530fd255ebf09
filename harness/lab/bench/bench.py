"""The whole measurement: trackers against the number of vehicles in range, then the mixtures."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from harness.common.errors import InputError
from harness.lab.bench.bench_scene import bench_scene
from harness.lab.bench.busy import busy_machine
from harness.lab.bench.measure import Contender, as_row, time_in_turns, warm_up
from mmpf.motion.gmm.conditional import expand
from mmpf.motion.gmm.model_file import committed_mixture
from mmpf.motion.learned.lane_changer import CHANGE
from mmpf.motion.learned.short_driver import SHORT
from mmpf.registry import UnknownNameError

VEHICLES = (10, 25, 50, 100, 200)
STEPS = 40
SLOPE_FROM = 25
MIXTURE_PARTICLES, REPETITIONS = 40_000, 15
COARSE = "coarse"
"""How much of the time that they may take trackers use, most of them far less than all of it."""
STONE_SOUP = ("stonesoup-gnn", "stonesoup-jpda")
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
        beside: Processes that spin beside the measurement, as on a busy machine.
    """

    vehicles: tuple[int, ...] = VEHICLES
    trackers: tuple[str, ...] = ()
    particles: int = 1000
    steps: int = STEPS
    seed: int = 0
    budget_s: float = 10.0
    beside: int = 0

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
        return Contender(name, tracker, {"coarse_gate": True} if variant else {})
    return Contender(name, name)


def run_bench(plan: BenchPlan, advance: Callable[[], None]) -> dict[str, Any]:
    """Measure everything.

    Args:
        plan: What is measured.
        advance: Called after each scan of each scene.

    Returns:
        ``beside``, ``rows``, ``gmm`` and ``slopes`` as plain values.

    Raises:
        InputError: There is no such tracker or model, or it is none that can be timed.
    """
    contenders = plan.contenders
    try:
        warm_up(contenders, bench_scene(min(plan.vehicles), plan.steps, np.random.default_rng(plan.seed)))
    except (UnknownNameError, TypeError) as error:
        raise InputError(f"`trackers`: {error}") from None
    rows: list[dict[str, Any]] = []
    # As in a run: all trackers' matrix products are small, and one thread is the fastest on a busy machine.
    with threadpool_limits(limits=1, user_api="blas"), busy_machine(plan.beside):
        for vehicles in plan.vehicles:
            scene = bench_scene(vehicles, plan.steps, np.random.default_rng([plan.seed, vehicles]))
            done = time_in_turns(contenders, scene, plan.budget_s, advance)
            rows += [as_row(stepping, vehicles) for stepping in done]
        mixtures = time_mixtures(np.random.default_rng(plan.seed))
    return {"beside": plan.beside, "rows": rows, "gmm": mixtures, "slopes": slopes(rows)}


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


def time_mixtures(rng: np.random.Generator) -> list[dict[str, object]]:
    """Return a row for each committed mixture: the published 28 components of 5 inputs, and 60 of 14.

    Conditional sampling is timed beside the bare matrix product that it can't do without.
    """
    rows: list[dict[str, object]] = []
    for kind in (SHORT, CHANGE):
        mixture = committed_mixture(kind).mixture
        x = rng.standard_normal((MIXTURE_PARTICLES, mixture.inputs))
        expanded = expand(x).astype(np.float32)
        matrix = np.ascontiguousarray(mixture.logit_matrix.T, dtype=np.float32)
        product_ms, sample_ms = _medians_ms(
            lambda expanded=expanded, matrix=matrix: expanded @ matrix,  # type: ignore[misc]
            lambda mixture=mixture, x=x: mixture.sample(x, rng),  # type: ignore[misc]
        )
        rows.append({
            "components": len(mixture.weights),
            "inputs": mixture.inputs,
            "outputs": mixture.outputs,
            "particles": MIXTURE_PARTICLES,
            "ms": sample_ms,
            "matrix_product_ms": product_ms,
        })  # fmt: skip
    return rows


def _medians_ms(*works: Callable[[], object]) -> list[float]:
    """Return the median wall time of each work, done in turns after one warm-up."""
    took_ms: list[list[float]] = [[] for _ in works]
    for repetition in range(REPETITIONS + 1):
        for place, work in enumerate(works):
            begin = perf_counter()
            work()
            if repetition:
                took_ms[place].append(1e3 * (perf_counter() - begin))
    return [float(np.median(values)) for values in took_ms]
