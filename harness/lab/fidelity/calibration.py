"""Runs a calibration from request to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.common.files import write_text
from harness.lab.fidelity import candidate as outcome
from harness.lab.fidelity.candidate import Candidate, averaged, first_candidate, improved, misfit, with_bolder_drivers
from harness.lab.fidelity.fields import read_fields
from harness.lab.fidelity.measured import MeasuredSite, measure, measure_vehicles, read_measured, write_measured
from harness.lab.fidelity.samples import VehicleStatistics, merged
from harness.lab.fidelity.simulate import RunJob, simulate_all
from harness.lab.fidelity.statistics import PeriodStatistics, period_statistics
from harness.truth.network.network import Network

# The first steps go almost all the way; later ones follow less what differs from seed to seed.
LAST_STEP = 0.3
SKIP_S = 30.0


@dataclass(frozen=True)
class CalibrationRequest:
    """The request of a calibration.

    Attributes:
        seeds: Seeds of the first candidate's runs; each further one takes the next as many.
        fresh: Whether to begin with the measurements rather than with the calibration that is there.
        first_step: Share of what is missing that is made up for after the first trial.
    """

    fields: Path | None
    demand: str | None
    trials: int
    seeds: tuple[int, ...]
    duration_s: float
    keep_drivers: bool
    fresh: bool
    workers: int
    first_step: float
    recordings: tuple[Path, ...] = ()

    @property
    def leaves_drivers(self) -> bool:
        """Whether drivers stay as they are, since other demands or fitted models depend on them."""
        return self.keep_drivers or self.demand is not None

    def names(self, site: MeasuredSite) -> tuple[str, ...]:
        """Return the demands to be calibrated."""
        if self.demand is None:
            return tuple(site.periods)
        site.period(self.demand)
        return (self.demand,)

    def runs(self, network: Network) -> int:
        """Return how many runs there will be."""
        return self.trials * len(self.seeds) * len(self.names(read_measured(network)))


@dataclass(frozen=True)
class Trial:
    """One candidate, what it led to, and its ``misfit``, see ``harness.lab.fidelity.candidate.misfit``."""

    candidate: Candidate
    simulated: Mapping[str, PeriodStatistics]
    vehicles: VehicleStatistics
    misfit: float


@dataclass(frozen=True)
class CalibrationResult:
    """What a calibration found.

    Attributes:
        outcome: The mean of the later half of the candidates.
        measured_anew: Whether figures come from fields or recordings that the user gave.
    """

    site: MeasuredSite
    trials: tuple[Trial, ...]
    outcome: Candidate
    measured_anew: bool

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {"outcome": outcome.as_table(self.outcome), "trials": [_trial_table(trial) for trial in self.trials]}

    def write(self, folder: Path, network: Network | None) -> None:
        """Write ``calibration.json`` and ``calibration.toml`` to a folder, and into a network's if one is given."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_text(folder / "calibration.json", json.dumps(self.as_json(), indent=2) + "\n")
            outcome.write_candidate(folder / "calibration.toml", self.outcome)
        except OSError as error:
            raise InputError(f"`out` {folder}: cannot be written: {error.strerror}") from error
        if network is not None and network.calibration_file is not None:
            outcome.write_candidate(network.calibration_file, self.outcome.with_others(network))
            if self.measured_anew and network.measured_file is not None:
                write_measured(network.measured_file, self.site)


def calibrate(
    network: Network, request: CalibrationRequest, on_run: Callable[[], None], say: Callable[[str], None]
) -> CalibrationResult:
    """Search for the drivers and demands that fit best.

    Raises:
        InputError: The network has no measurements, the demand is none of them, or the fields cannot be read.
    """
    site = read_measured(network)
    if request.fields is not None:
        site = measure(site, read_fields(request.fields), network.main_road.main_lanes)
    site = measure_vehicles(site, request.recordings, network.name)
    names = request.names(site)
    first = first_candidate(network, site, names, request.leaves_drivers)
    if not request.fresh and set(names) <= set(network.calibrated):
        first = Candidate(network.drivers, {name: network.demand_files[name] for name in names})
    trials: list[Trial] = []

    def keep(trial: Trial) -> None:
        trials.append(trial)
        say(_line(len(trials), trial))

    found = search(network, site, first, request, keep, on_run)
    return CalibrationResult(site, tuple(trials), found, request.fields is not None or bool(request.recordings))


def search(
    network: Network,
    site: MeasuredSite,
    first: Candidate,
    request: CalibrationRequest,
    on_trial: Callable[[Trial], None],
    on_run: Callable[[], None],
) -> Candidate:
    """Return the mean of the later half of the candidates that a fixed-point iteration goes through.

    Figures differ from seed to seed, so that the trial with the least misfit is the luckiest rather than the best.
    Candidates circle about what fits on the mean of all seeds, and their average comes nearer to it than any of them
    (Polyak and Juditsky, Acceleration of stochastic approximation by averaging, 1992). The candidate that the last
    trial leads to is averaged with the others.
    """
    candidates = [first]
    for number in range(request.trials):
        candidate = candidates[-1]
        seeds = [seed + number * len(request.seeds) for seed in request.seeds]
        simulated, vehicles = _simulate(candidate.on(network), site, tuple(first.demands), seeds, request, on_run)
        on_trial(Trial(candidate, simulated, vehicles, misfit(simulated, site, vehicles)))
        step = max(LAST_STEP, request.first_step / (1.0 + 0.3 * number))
        candidate = improved(candidate, simulated, site, step, request.leaves_drivers)
        if site.vehicles is not None and not request.leaves_drivers:
            candidate = with_bolder_drivers(candidate, vehicles, site.vehicles.figures, step)
        candidates.append(candidate)
    return averaged(candidates[len(candidates) // 2 :])


def _simulate(
    network: Network,
    site: MeasuredSite,
    names: Sequence[str],
    seeds: Sequence[int],
    request: CalibrationRequest,
    on_run: Callable[[], None],
) -> tuple[dict[str, PeriodStatistics], VehicleStatistics]:
    """Return the figures of each demand and of all vehicles; schedules are compressed to the duration."""
    duration_s, jobs = request.duration_s, []
    for name in names:
        demand, compression = network.demand_files[name], duration_s / site.periods[name].duration_s
        schedule = tuple((from_s * compression, density, waves) for from_s, density, waves in demand.schedule)
        shortened = network.with_demand(name, demand.model_copy(update={"schedule": schedule}))
        jobs += [RunJob(shortened, name, duration_s, seed) for seed in seeds]
    made = simulate_all(jobs, request.workers, on_run)
    runs = iter(made)
    figures = {}
    for name in names:
        period = site.periods[name]
        skip_s = max(SKIP_S, duration_s / period.duration_s * period.skip_s)
        kept = [next(runs).fields.between(skip_s, duration_s) for _ in seeds]
        figures[name] = period_statistics(kept, network.main_road.main_lanes)
    return figures, merged(run.samples for run in made).statistics()


def _line(number: int, trial: Trial) -> str:
    parts = (
        f"{name}: {figures.mean_speed_mps:.2f} m/s, {figures.flow_veh_per_h:.0f} veh/h, "
        f"{100.0 * figures.share_below_4mps:.1f} % slow, waves {figures.wave_mps:.1f} m/s"
        for name, figures in trial.simulated.items()
    )
    driving = (
        f"{trial.vehicles.lane_changes_per_km:.2f} lane changes a vehicle-km, "
        f"accelerations spread by {trial.vehicles.acceleration_spread_mps2:.2f} m/s²"
    )
    return f"trial {number}, misfit {trial.misfit:.2f} (1 = just within what is allowed); " + "; ".join(
        (*parts, driving)
    )


def _trial_table(trial: Trial) -> dict[str, Any]:
    return {
        "misfit": trial.misfit,
        "simulated": {name: asdict(figures) for name, figures in trial.simulated.items()},
        "vehicles": asdict(trial.vehicles),
        **outcome.as_table(trial.candidate),
    }
