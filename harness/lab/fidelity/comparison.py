"""Compares simulated with recorded traffic."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import wasserstein_distance

from harness.common.errors import InputError
from harness.lab.fidelity.fields import Fields, read_fields
from harness.lab.fidelity.measured import MeasuredSite, measure, read_measured
from harness.lab.fidelity.samples import (
    RATE,
    RATE_UNIT,
    UNITS,
    BehaviourSamples,
    merged,
    recorded_samples,
    recording_files,
)
from harness.lab.fidelity.simulate import RunJob, SimulatedRun, simulate_all
from harness.lab.fidelity.statistics import PeriodStatistics, Target, period_statistics, targets
from harness.truth.network.network import Network


@dataclass(frozen=True)
class FidelityRequest:
    """The request of a comparison with measured traffic.

    Attributes:
        demands: Demands to be compared; none for all that were measured.
        seeds: Seeds of each demand's runs.
        duration_s: Simulated time of a run.
        fields: Folder of the recorded fields; None to take the figures that travel with the network.
        recordings: Files and folders of recorded vehicles.
        workers: Runs at a time.
    """

    demands: tuple[str, ...]
    seeds: tuple[int, ...]
    duration_s: float
    fields: Path | None
    recordings: tuple[Path, ...]
    workers: int

    def runs(self, network: Network) -> int:
        """Return how many runs there will be."""
        return len(self.seeds) * len(self.demands or read_measured(network).periods)


@dataclass(frozen=True)
class Period:
    """One period on both sides.

    Attributes:
        fields: One simulated run's fields, and the recorded ones if they are there.
    """

    demand: str
    simulated: PeriodStatistics
    measured: PeriodStatistics
    seeds: tuple[PeriodStatistics, ...]
    targets: tuple[Target, ...]
    fields: tuple[Fields, Fields | None]


@dataclass(frozen=True)
class Distance:
    """How far apart two distributions are, by Wasserstein's distance; of a rate, the difference.

    Attributes:
        quantity: What is distributed.
        unit: Its unit, the distance's too.
        distance: Wasserstein distance; for a rate, the difference.
        simulated_mean: Mean of the simulated samples.
        measured_mean: Mean of the recorded ones.
        simulated_n: Number of simulated samples.
        measured_n: Number of recorded ones.
    """

    quantity: str
    unit: str
    distance: float
    simulated_mean: float
    measured_mean: float
    simulated_n: int
    measured_n: int


@dataclass(frozen=True)
class Fidelity:
    """How real the traffic is.

    Attributes:
        source: Where the measurements are published.
        distances: Distances of the distributions; none without recorded vehicles.
        samples: Simulated and recorded samples; None without recorded vehicles.
        left_out: What could not be compared, and why.
    """

    network: str
    source: str
    periods: tuple[Period, ...]
    distances: tuple[Distance, ...]
    samples: tuple[BehaviourSamples, BehaviourSamples] | None
    left_out: tuple[str, ...]
    setting: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Return the figures as plain values."""
        return {
            "net": self.network,
            "source": self.source,
            **self.setting,
            "periods": {
                period.demand: {
                    "sim": asdict(period.simulated),
                    "real": asdict(period.measured),
                    "sim_by_seed": [asdict(entry) for entry in period.seeds],
                    "targets": [asdict(entry) | {"met": entry.met} for entry in period.targets],
                }
                for period in self.periods
            },
            "distances": {
                entry.quantity: {key: value for key, value in asdict(entry).items() if key != "quantity"}
                for entry in self.distances
            },
            "left_out": list(self.left_out),
        }


def compare_traffic(network: Network, request: FidelityRequest, on_run: Callable[[], None]) -> Fidelity:
    """Simulate the periods and compare them with what was measured.

    Raises:
        InputError: The network has no measurements, a demand was not measured, or a file cannot be read.
    """
    site, fields = _measured(network, request)
    demands = request.demands or tuple(site.periods)
    left_out = []
    for demand in demands:
        period = site.period(demand)
        network.demand(demand)
        if request.duration_s <= period.skip_s:
            raise InputError(
                f"`minutes` {request.duration_s / 60.0:g}: the first {period.skip_s / 60.0:g} of {demand} are left "
                "out; give more than that, 15 for example"
            )
    files = recording_files(request.recordings)
    recorded = recorded_samples(files, network.name) if files else None
    jobs = [RunJob(network, demand, request.duration_s, seed) for demand in demands for seed in request.seeds]
    runs = simulate_all(jobs, request.workers, on_run)
    count = len(request.seeds)
    grouped = {demand: runs[k * count : (k + 1) * count] for k, demand in enumerate(demands)}
    lanes = network.main_road.main_lanes
    periods = tuple(_period(demand, grouped[demand], site, fields, request.duration_s, lanes) for demand in demands)
    simulated = merged(run.samples for run in runs)
    if fields is None:
        left_out.append("speed fields of the road: the recorded ones are not there; give their folder as `fields`")
    if recorded is None:
        left_out.append("distributions: no recorded vehicles are there; give files or folders as `recordings`")
    return Fidelity(
        network=network.name,
        source=site.source,
        periods=periods,
        distances=distances(simulated, recorded) if recorded is not None else (),
        samples=(simulated, recorded) if recorded is not None else None,
        left_out=tuple(left_out),
        setting={
            "seeds": list(request.seeds),
            "minutes": request.duration_s / 60.0,
            "recordings": [file.name for file in files],
        },
    )


def distances(simulated: BehaviourSamples, recorded: BehaviourSamples) -> tuple[Distance, ...]:
    """Return the distances of all quantities that both sides have samples of."""
    found = []
    for quantity, unit in UNITS.items():
        first, second = simulated.values[quantity], recorded.values[quantity]
        if len(first) and len(second):
            distance = float(wasserstein_distance(first, second))
            means = float(np.mean(first)), float(np.mean(second))
            found.append(Distance(quantity, unit, distance, *means, len(first), len(second)))
    if simulated.vehicle_km > 0.0 and recorded.vehicle_km > 0.0:
        rates = simulated.changes_per_km, recorded.changes_per_km
        found.append(
            Distance(RATE, RATE_UNIT, abs(rates[0] - rates[1]), *rates, simulated.lane_changes, recorded.lane_changes)
        )
    return tuple(found)


def _measured(network: Network, request: FidelityRequest) -> tuple[MeasuredSite, Fields | None]:
    site = read_measured(network)
    if request.fields is None:
        return site, None
    fields = read_fields(request.fields)
    return measure(site, fields, network.main_road.main_lanes), fields


def _period(
    demand: str,
    runs: Sequence[SimulatedRun],
    site: MeasuredSite,
    recorded: Fields | None,
    duration_s: float,
    lanes: int,
) -> Period:
    entry = site.periods[demand]
    kept = [run.fields.between(entry.skip_s, duration_s) for run in runs]
    simulated = period_statistics(kept, lanes)
    whole = recorded.between(entry.start_s, entry.start_s + entry.duration_s) if recorded is not None else None
    return Period(
        demand=demand,
        simulated=simulated,
        measured=entry.statistics,
        seeds=tuple(period_statistics([piece], lanes) for piece in kept),
        targets=targets(simulated, entry.statistics),
        fields=(runs[0].fields, whole),
    )
