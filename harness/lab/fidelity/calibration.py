"""Runs a calibration from its options to its files."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.common.files import write_text, write_toml, writing
from harness.common.numbers import rounded
from harness.common.progress import progress_bar
from harness.config.lists import seed_values
from harness.lab.fidelity.candidate import (
    Candidate,
    as_table,
    averaged,
    first_candidate,
    improved,
    misfit,
    with_bolder_drivers,
    write_candidate,
)
from harness.lab.fidelity.fields import read_fields
from harness.lab.fidelity.measured import MEASURED_COMMENT, MeasuredSite, measure, measure_vehicles, read_measured
from harness.lab.fidelity.samples import VehicleStatistics, merged
from harness.lab.fidelity.simulate import RunJob, simulate_all, within
from harness.lab.fidelity.statistics import PeriodStatistics, period_statistics
from harness.truth.network.network import Network, load_network

# The first steps go almost all the way; later ones follow less what differs from seed to seed.
LAST_STEP = 0.3
SKIP_S = 30.0


def calibrate(options: Mapping[str, Any], say: Callable[[str], object]) -> tuple[dict[str, Any], list[Path]]:
    """Search for the drivers and demands that fit best, and write the mean of the later half of the candidates.

    Figures differ from seed to seed, so that the trial with the least misfit is the luckiest rather than the best.
    Candidates circle about what fits on the mean of all seeds, and their average comes nearer to it than any of them
    (Polyak and Juditsky, Acceleration of stochastic approximation by averaging, 1992). The candidate that the last
    trial leads to is averaged with the others.

    Returns:
        The content of ``calibration.json``; the folder and, if it was asked for, the network's file.

    Raises:
        InputError: The network has no measurements, the demand is none of them, or the fields cannot be read.
    """
    network, out = load_network(str(options["net"] or "us101")), options["out"]
    if network.calibration_file is None and options["write"]:
        raise InputError(f"`write`: {network.name} names no calibration_file in its network.toml")
    site, names = _measured(network, options)
    # Other demands or fitted models depend on the drivers.
    keep_drivers = options["keep_drivers"] or options["demand"] is not None
    candidates = [first_candidate(network, site, names, keep_drivers)]
    if not options["fresh"] and set(names) <= set(network.calibrated):
        candidates = [Candidate(network.drivers, {name: network.demand_files[name] for name in names})]
    trials: list[dict[str, Any]] = []
    seeds, title = seed_values(options["seeds"]), "calibrate: the first simulations"
    with progress_bar(
        "calibrate", options["trials"] * len(seeds) * len(names), options["quiet"], before=title
    ) as advance:
        for number in range(options["trials"]):
            candidate, own = candidates[-1], [seed + number * len(seeds) for seed in seeds]
            simulated, vehicles = _simulate(candidate.on(network), site, names, own, options, advance)
            off = misfit(simulated, site, vehicles)
            told = {"simulated": {name: asdict(figures) for name, figures in simulated.items()}}
            trials.append({"misfit": off, **told, "vehicles": asdict(vehicles), **as_table(candidate)})
            say(_line(len(trials), simulated, vehicles, off))
            step = max(LAST_STEP, options["step"] / (1.0 + 0.3 * number))
            candidate = improved(candidate, simulated, site, step, keep_drivers)
            if site.vehicles is not None and not keep_drivers:
                candidate = with_bolder_drivers(candidate, vehicles, site.vehicles.figures, step)
            candidates.append(candidate)
    outcome = averaged(candidates[len(candidates) // 2 :])
    table = {"outcome": as_table(outcome), "trials": trials}
    with writing("out", out):
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "calibration.json", json.dumps(table, indent=2) + "\n")
        write_candidate(out / "calibration.toml", outcome)
    if not options["write"] or network.calibration_file is None:
        return table, [out]
    # Demands that were calibrated before, and are not part of it, stay.
    others = {name: network.demand_files[name] for name in network.calibrated}
    write_candidate(network.calibration_file, Candidate(outcome.drivers, {**others, **outcome.demands}))
    if (options["fields"] is not None or options["recordings"]) and network.measured_file is not None:
        write_toml(network.measured_file, rounded(site.model_dump(exclude_none=True), 4), MEASURED_COMMENT)
    return table, [out, network.calibration_file]


def _measured(network: Network, options: Mapping[str, Any]) -> tuple[MeasuredSite, tuple[str, ...]]:
    """Return the measurements, from fields and recordings if these are given, and the demands to be calibrated."""
    site = read_measured(network)
    if options["fields"] is not None:
        site = measure(site, read_fields(options["fields"]), network.main_road.main_lanes)
    site = measure_vehicles(site, options["recordings"] or (), network.name)
    if options["demand"] is None:
        return site, tuple(site.periods)
    site.period(options["demand"])
    return site, (options["demand"],)


def _simulate(
    network: Network,
    site: MeasuredSite,
    names: Sequence[str],
    seeds: Sequence[int],
    options: Mapping[str, Any],
    on_run: Callable[[], None],
) -> tuple[dict[str, PeriodStatistics], VehicleStatistics]:
    """Return the figures of each demand and of all vehicles; schedules are compressed to the duration."""
    duration_s, jobs = 60.0 * options["minutes"], []
    for name in names:
        shortened = within(network, name, site.periods[name].duration_s, duration_s)
        jobs += [RunJob(shortened, name, duration_s, seed) for seed in seeds]
    made = simulate_all(jobs, options["workers"], on_run)
    fields = iter([each for each, _ in made])
    figures = {}
    for name in names:
        period = site.periods[name]
        skip_s = max(SKIP_S, duration_s / period.duration_s * period.skip_s)
        kept = [next(fields).between(skip_s, duration_s) for _ in seeds]
        figures[name] = period_statistics(kept, network.main_road.main_lanes)
    return figures, merged(samples for _, samples in made).statistics()


def _line(number: int, simulated: dict[str, PeriodStatistics], vehicles: VehicleStatistics, off: float) -> str:
    parts = (
        f"{name}: {figures.mean_speed_mps:.2f} m/s, {figures.flow_veh_per_h:.0f} veh/h, "
        f"{100.0 * figures.share_below_4mps:.1f} % slow, waves {figures.wave_mps:.1f} m/s"
        for name, figures in simulated.items()
    )
    driving = (
        f"{vehicles.lane_changes_per_km:.2f} lane changes a vehicle-km, "
        f"accelerations spread by {vehicles.acceleration_spread_mps2:.2f} m/s²"
    )
    return f"trial {number}, misfit {off:.2f} (1 = just within what is allowed); " + "; ".join((*parts, driving))
