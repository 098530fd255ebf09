"""Compares simulated with recorded traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.stats import wasserstein_distance

from harness.common.errors import InputError
from harness.common.progress import progress_bar
from harness.config.lists import names, seed_values
from harness.lab.fidelity.fields import Fields, read_fields
from harness.lab.fidelity.measured import MeasuredPeriod, MeasuredSite, measure, read_measured
from harness.lab.fidelity.options import FidelityOptions
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
from harness.lab.fidelity.statistics import period_statistics, targets
from harness.truth.network.network import Network


def _asked_demands(site: MeasuredSite, network: Network, options: FidelityOptions) -> tuple[str, ...]:
    """Return the demands to be compared, or raise ``InputError``."""
    asked = options["demand"]
    demands = tuple(site.periods) if asked is None else names(asked, "--demand", "us101-0805")
    for demand in demands:
        skip_s = site.period(demand).skip_s
        network.demand(demand)
        if 60.0 * options["minutes"] <= skip_s:
            raise InputError(
                f"`minutes` {options['minutes']:g}: the first {skip_s / 60.0:g} of {demand} are left out; give more "
                "than that, 15 for example"
            )
    return demands


def compare_traffic(
    network: Network, options: FidelityOptions
) -> tuple[dict[str, Any], dict[str, tuple[Fields, Fields]], tuple[BehaviourSamples, BehaviourSamples] | None]:
    """Simulate the periods and compare them with what was measured.

    Returns:
        All figures, as ``fidelity.json`` holds them; by demand one simulated run's fields, and the recorded ones, none
        where these are not there; simulated and recorded samples, None without recorded vehicles.

    Raises:
        InputError: The network has no measurements or no such demand, a demand was not measured, the runs are too
            short, or a file cannot be read.
    """
    site, lanes = read_measured(network), network.main_road.main_lanes
    recorded_fields: Fields | None = None
    if options["fields"] is not None:
        recorded_fields = read_fields(options["fields"])
        site = measure(site, recorded_fields, lanes)
    demands, seeds = _asked_demands(site, network, options), list(seed_values(options["seeds"]))
    files = recording_files(options["recordings"] or ())
    recorded = recorded_samples(files, network.name) if files else None
    jobs = [RunJob(network, demand, 60.0 * options["minutes"], seed) for demand in demands for seed in seeds]
    with progress_bar("fidelity", len(jobs), options["quiet"], before="fidelity: the first simulations") as advance:
        runs = simulate_all(jobs, options["workers"], advance)
    of_demand = {demand: runs[k * len(seeds) : (k + 1) * len(seeds)] for k, demand in enumerate(demands)}
    samples = None if recorded is None else (merged(own for _, own in runs), recorded)
    left_out = []
    if recorded_fields is None:
        left_out.append("speed fields of the road: the recorded ones are not there; give their folder as `fields`")
    if samples is None:
        left_out.append("distributions: no recorded vehicles are there; give files or folders as `recordings`")
    table = {
        "net": network.name,
        "source": site.source,
        "seeds": seeds,
        "minutes": options["minutes"],
        "recordings": [file.name for file in files],
        "periods": {
            demand: _period(own, site.periods[demand], 60.0 * options["minutes"], lanes)
            for demand, own in of_demand.items()
        },
        "distances": {} if samples is None else distances(*samples),
        "left_out": left_out,
    }
    if recorded_fields is None:
        return table, {}, samples
    periods = ((demand, site.periods[demand]) for demand in of_demand)
    whole = {name: recorded_fields.between(each.start_s, each.start_s + each.duration_s) for name, each in periods}
    return table, {name: (own[0][0], whole[name]) for name, own in of_demand.items()}, samples


def distances(simulated: BehaviourSamples, recorded: BehaviourSamples) -> dict[str, dict[str, Any]]:
    """Return how far apart the distributions are of all quantities that both sides have samples of.

    Returns:
        By quantity Wasserstein's ``distance`` in its ``unit``, of the rate of lane changes the difference, and mean and
        number of the samples of both sides.
    """
    found: dict[str, dict[str, Any]] = {}
    for quantity, unit in UNITS.items():
        both = simulated.by_quantity[quantity], recorded.by_quantity[quantity]
        if all(map(len, both)):
            found[quantity] = _sides(
                unit, wasserstein_distance(*both), tuple(map(np.mean, both)), tuple(map(len, both))
            )
    if simulated.vehicle_km > 0.0 and recorded.vehicle_km > 0.0:
        rates = [simulated.changes_per_km, recorded.changes_per_km]
        changes = [simulated.lane_changes, recorded.lane_changes]
        found[RATE] = _sides(RATE_UNIT, abs(rates[0] - rates[1]), rates, changes)
    return found


def _sides(unit: str, distance: float, means: Sequence[Any], numbers: Sequence[int]) -> dict[str, Any]:
    sides = ("simulated", "measured")
    return {
        "unit": unit,
        "distance": float(distance),
        **{f"{side}_mean": float(mean) for side, mean in zip(sides, means, strict=True)},
        **{f"{side}_n": number for side, number in zip(sides, numbers, strict=True)},
    }


def _period(runs: Sequence[SimulatedRun], period: MeasuredPeriod, duration_s: float, lanes: int) -> dict[str, Any]:
    kept = [fields.between(period.skip_s, duration_s) for fields, _ in runs]
    simulated = period_statistics(kept, lanes)
    return {
        "sim": asdict(simulated),
        "real": asdict(period.statistics),
        "sim_by_seed": [asdict(period_statistics([piece], lanes)) for piece in kept],
        "targets": [asdict(each) | {"met": each.met} for each in targets(simulated, period.statistics)],
    }
