"""The search of the calibration: simulate a candidate, compare, improve, and average what the search circles about."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from harness.fidelity.candidate import Candidate, averaged, improved, misfit
from harness.fidelity.measured import MeasuredSite
from harness.fidelity.simulate import RunJob, simulate_all
from harness.fidelity.statistics import PeriodStatistics, period_statistics
from harness.truth.network.network import Network
from harness.truth.network.networkfile import DemandFile

# The first steps go almost all the way; later ones follow less what differs from seed to seed.
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
    first_step: float = FIRST_STEP,
) -> Candidate:
    """Return the mean of the later half of the candidates that a fixed-point iteration goes through.

    Figures differ from seed to seed, so that the trial with the least misfit is the luckiest rather than the best.
    Candidates circle about what fits on the mean of all seeds, and their average comes nearer to it than any of them
    (Polyak and Juditsky, Acceleration of stochastic approximation by averaging, 1992).

    Args:
        network: The network that is calibrated.
        site: The measured figures.
        first: The candidate to begin with.
        trials: How many candidates are simulated; the one that the last of them leads to is averaged with the others.
        seeds: Seeds of the first candidate's runs; each further candidate takes the next as many.
        duration_s: Simulated time of a run; the demand's schedule is compressed to it.
        workers: How many runs are made at a time, each in a process of its own.
        on_trial: Called after each trial.
        on_run: Called after each run.
        keep_drivers: Whether the drivers stay as they are, since other demands or fitted models depend on them.
        first_step: Share of what is missing that is made up for after the first trial.
    """
    candidates = [first]
    for number in range(trials):
        candidate = candidates[-1]
        fresh = [seed + number * len(seeds) for seed in seeds]
        simulated = _simulate(candidate.on(network), site, tuple(first.demands), fresh, duration_s, workers, on_run)
        on_trial(Trial(candidate, simulated, misfit(simulated, site)))
        step = max(LAST_STEP, first_step / (1.0 + 0.3 * number))
        candidates.append(improved(candidate, simulated, site, step, keep_drivers))
    return averaged(candidates[len(candidates) // 2 :])


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
