"""The search of the calibration: simulate a candidate, compare, improve, and keep the best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from harness.fidelity.candidate import Candidate, improved, misfit
from harness.fidelity.measured import MeasuredSite
from harness.fidelity.simulate import RunJob, simulate_all
from harness.fidelity.statistics import PeriodStatistics, period_statistics
from harness.truth.network import DemandFile, Network

# The first steps go all the way; later ones average out what differs from seed to seed.
FIRST_STEP, LAST_STEP = 0.9, 0.3
SKIP_S = 30.0


@dataclass(frozen=True)
class Trial:
    """One candidate and what it led to.

    Attributes:
        candidate: The candidate.
        simulated: Its figures by demand.
        misfit: How far it is off; see ``candidate.misfit``.
    """

    candidate: Candidate
    simulated: Mapping[str, PeriodStatistics]
    misfit: float


def search(
    network: Network,
    site: MeasuredSite,
    first: Candidate,
    trials: int,
    seeds: Sequence[int],
    duration_s: float,
    workers: int,
    on_trial: Callable[[Trial], None],
    on_run: Callable[[], None] = lambda: None,
    keep_drivers: bool = False,
) -> Trial:
    """Return the best of a number of trials.

    Args:
        network: The network that is calibrated.
        site: The measured figures.
        first: The candidate to begin with.
        trials: How many candidates are simulated.
        seeds: Seeds of each candidate's runs, in turn: every trial takes all of them.
        duration_s: Simulated time of a run; the demand's schedule is compressed to it.
        workers: How many runs are made at a time, each in a process of its own.
        on_trial: Called after each trial.
        on_run: Called after each run.
        keep_drivers: Whether the drivers stay as they are, since other demands depend on them.
    """
    candidate, best = first, None
    for number in range(trials):
        simulated = _simulate(candidate.on(network), site, tuple(first.demands), seeds, duration_s, workers, on_run)
        trial = Trial(candidate, simulated, misfit(simulated, site))
        on_trial(trial)
        if best is None or trial.misfit < best.misfit:
            best = trial
        step = max(LAST_STEP, FIRST_STEP / (1.0 + 0.3 * number))
        candidate = improved(candidate, simulated, site, step, keep_drivers)
    assert best is not None
    return best


def _simulate(
    network: Network,
    site: MeasuredSite,
    names: Sequence[str],
    seeds: Sequence[int],
    duration_s: float,
    workers: int,
    on_run: Callable[[], None],
) -> dict[str, PeriodStatistics]:
    jobs = []
    for name in names:
        compressed = _compressed(network.demand_files[name], duration_s / site.periods[name].duration_s)
        shortened = network.with_demand(name, compressed)
        jobs += [RunJob(shortened, name, duration_s, seed) for seed in seeds]
    runs = iter(simulate_all(jobs, workers, on_run))
    figures = {}
    for name in names:
        period = site.periods[name]
        skip_s = max(SKIP_S, duration_s / period.duration_s * period.skip_s)
        kept = [next(runs).fields.between(skip_s, duration_s) for _ in seeds]
        figures[name] = period_statistics(kept, network.corridor.main_lanes)
    return figures


def _compressed(demand: DemandFile, compression: float) -> DemandFile:
    schedule = tuple((from_s * compression, density, waves) for from_s, density, waves in demand.schedule)
    return demand.model_copy(update={"schedule": schedule})
