"""A candidate of the calibration: drivers and demands, how they are improved, and the file of the result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any, cast

import numpy as np

from harness.common.files import write_toml
from harness.lab.fidelity.measured import PART_S, MeasuredPeriod, MeasuredSite
from harness.lab.fidelity.samples import VehicleStatistics
from harness.lab.fidelity.statistics import QUARTERS, PeriodStatistics, targets
from harness.storage.schema import DENSITY_RANGE
from harness.truth.network.demand import Drivers
from harness.truth.network.network import Network
from harness.truth.network.networkfile import DemandFile

WAVE_PERIOD_S = 120.0
FIRST_AMPLITUDE = 0.7
# Share of the waves' amplitude in parts of a period without slow cells.
WEAKEST_WAVES = 0.2
# So far behind the section headways are back to the drivers' own, so that the exit decides what leaves.
BACK_WITHIN_M = 60.0
# Change of the waves' amplitude per share of slow cells that is missing: what a normal distribution of speeds about
# 8 m/s would ask for, whose spread is proportional to the amplitude, where a tenth of the cells is slow. In the most
# congested period simulated traffic answers less than that: there slow cells go with the mean speed.
AMPLITUDE_GAIN = 2.0
AMPLITUDE_RANGE = (0.05, 0.9)
RAMP_GAIN = 0.5
RAMP_RANGE_VEH_PER_H = (0.0, 900.0)
FACTOR_RANGE = (0.6, 1.6)
GAP_RANGE_M = (2.0, 5.5)
GAP_GAIN = 0.5
# Lane changes go with about the square of the assertiveness, the spread of accelerations with the root of the scale.
ASSERTIVENESS_GAIN, ASSERTIVENESS_RANGE = 0.5, (0.5, 5.0)
ACCELERATION_GAIN, ACCELERATION_RANGE = 1.0, (0.8, 2.2)
# As far as one step may go; a rate over a short run is a noisy one.
FURTHEST_STEP = 0.4
CHANGES_PERCENT, SPREAD_PERCENT = 20.0, 15.0
FIRST_ASSERTIVENESS = 1.0


@dataclass(frozen=True)
class Candidate:
    """What is calibrated: the network's drivers, the same in all periods, and the periods' demands."""

    drivers: Drivers
    demands: Mapping[str, DemandFile]

    def on(self, network: Network) -> Network:
        """Return a network with these drivers and demands."""
        return replace(network, drivers=self.drivers, demand_files={**network.demand_files, **self.demands})


def first_candidate(
    network: Network, site: MeasuredSite, names: tuple[str, ...], keep_drivers: bool = False
) -> Candidate:
    """Return what the measurements say by themselves: densities of each five minutes, gaps that carry the flow."""
    drivers = network.drivers
    if not keep_drivers:
        found = [site.periods[name].statistics for name in names]
        spacings_m = [1000.0 / each.density_veh_per_km_lane - drivers.standing_spacing_m for each in found]
        headway_s = fmean(m / each.mean_speed_mps for m, each in zip(spacings_m, found, strict=True))
        drivers = drivers.model_copy(update={"headway_s": round(headway_s, 4)})
    start_m, end_m = network.section_m
    places_m = [round(start_m + (k + 0.5) / QUARTERS * (end_m - start_m), 1) for k in range(QUARTERS)]
    places_m.append(end_m + BACK_WITHIN_M)
    demands = {}
    for name in names:
        period = site.periods[name]
        demands[name] = network.demand_files[name].model_copy(
            update={
                "density_veh_per_km_lane": period.statistics.density_veh_per_km_lane,
                "schedule": _schedule(period),
                "headway_profile": tuple((place, 1.0) for place in places_m),
                "exit_wave_amplitude": FIRST_AMPLITUDE,
                "wave_period_s": WAVE_PERIOD_S,
            }
        )
    return Candidate(drivers, demands)


def _schedule(period: MeasuredPeriod) -> tuple[tuple[float, float, float], ...]:
    """Return a period's densities in turn, and waves that are strong where many cells were slow."""
    slowest = max(part.share_below_4mps for part in period.parts)
    return tuple(
        (
            k * PART_S,
            round(part.density_veh_per_km_lane, 2),
            round(max(WEAKEST_WAVES, (part.share_below_4mps / slowest) ** 0.5 if slowest else 0.0), 2),
        )
        for k, part in enumerate(period.parts)
    )


def misfit(
    simulated: Mapping[str, PeriodStatistics], site: MeasuredSite, vehicles: VehicleStatistics | None = None
) -> float:
    """Return the root mean square of all targets' errors, each over its tolerance; 1 where all are just met."""
    errors = [
        target.error / target.tolerance
        for name, entry in simulated.items()
        for target in targets(entry, site.periods[name].statistics)
    ]
    if vehicles is not None and site.vehicles is not None:
        found, measured = vehicles, site.vehicles.figures
        errors += [
            100.0 * (found.lane_changes_per_km / measured.lane_changes_per_km - 1.0) / CHANGES_PERCENT,
            100.0 * (found.acceleration_spread_mps2 / measured.acceleration_spread_mps2 - 1.0) / SPREAD_PERCENT,
        ]
    return float(np.sqrt(np.mean(np.square(np.nan_to_num(errors, nan=5.0)))))


def improved(
    candidate: Candidate,
    simulated: Mapping[str, PeriodStatistics],
    site: MeasuredSite,
    step: float,
    keep_drivers: bool = False,
) -> Candidate:
    """Return the next candidate of the fixed-point iteration.

    Each parameter has one figure that answers to it: the headway factor of a quarter of the road its effective headway
    (spacing beyond the standing one over speed), the ramps what flow is gained along the road, the densities the mean
    density, the waves' amplitude the share of slow cells, the minimum gap the speed of the waves. Each is moved towards
    the measured figure by ``step``, above 0 and at most 1, of what is missing. Drivers' mean headway is then set so
    that the factors' mean over all periods and quarters is one.
    """
    demands = {
        name: _improved_demand(candidate.demands[name], entry, site.periods[name].statistics, candidate.drivers, step)
        for name, entry in simulated.items()
    }
    if keep_drivers:
        return Candidate(candidate.drivers, demands)
    waves = [np.log(site.periods[name].statistics.wave_mps / entry.wave_mps) for name, entry in simulated.items()]
    missing = float(np.nan_to_num(np.clip(fmean(waves), -0.3, 0.3)))
    gap_m = candidate.drivers.minimum_gap_m + GAP_GAIN * step * missing * candidate.drivers.standing_spacing_m
    mean = fmean(factor for demand in demands.values() for _, factor in demand.headway_profile[:QUARTERS])
    moved = {"headway_s": round(candidate.drivers.headway_s * mean, 4), "minimum_gap_m": _within(gap_m, GAP_RANGE_M, 3)}
    drivers = candidate.drivers.model_copy(update=moved)
    return Candidate(drivers, {name: _scaled(demand, 1.0 / mean) for name, demand in demands.items()})


def with_bolder_drivers(
    candidate: Candidate, simulated: VehicleStatistics, measured: VehicleStatistics, step: float
) -> Candidate:
    """Return a candidate whose drivers change lanes and accelerate nearer to the measured ones.

    Assertiveness answers to the rate of lane changes, the largest accelerations to the spread of accelerations. What is
    not a number moves nothing.
    """
    changes = _missing(measured.lane_changes_per_km, simulated.lane_changes_per_km)
    spread = _missing(measured.acceleration_spread_mps2, simulated.acceleration_spread_mps2)
    drivers = candidate.drivers
    assertiveness = (drivers.assertiveness or FIRST_ASSERTIVENESS) * np.exp(step * ASSERTIVENESS_GAIN * changes)
    scale = drivers.acceleration_scale * np.exp(step * ACCELERATION_GAIN * spread)
    bolder = {
        "assertiveness": _within(assertiveness, ASSERTIVENESS_RANGE),
        "acceleration_scale": _within(scale, ACCELERATION_RANGE),
    }
    return replace(candidate, drivers=drivers.model_copy(update=bolder))


def _missing(measured: float, simulated: float) -> float:
    """Return the logarithm of what a figure has to be multiplied by, bounded; 0 where it is not a positive number."""
    if not (simulated > 0.0 and measured > 0.0):
        return 0.0
    return float(np.clip(np.log(measured / simulated), -FURTHEST_STEP, FURTHEST_STEP))


def averaged(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate whose every number is the mean of the candidates'."""
    drivers = Drivers.model_validate(_mean([each.drivers.model_dump() for each in candidates]))
    of_each = {name: [each.demands[name].model_dump() for each in candidates] for name in candidates[0].demands}
    return Candidate(drivers, {name: DemandFile.model_validate(_mean(tables)) for name, tables in of_each.items()})


def _mean(values: Sequence[object]) -> object:
    """Return the mean of numbers, entry by entry of what holds them; what is not a number is taken from the first."""
    match values[0]:
        case dict() as tables:
            return {key: _mean([value[key] for value in cast("Sequence[dict[str, object]]", values)]) for key in tables}
        case tuple():
            return tuple(_mean(entries) for entries in zip(*cast("Sequence[tuple[object, ...]]", values), strict=True))
        case float():
            return round(fmean(cast("Sequence[float]", values)), 4)
        case other:
            return other


def _improved_demand(
    demand: DemandFile, simulated: PeriodStatistics, measured: PeriodStatistics, drivers: Drivers, step: float
) -> DemandFile:
    headways = (_quarter_headways_s(statistics, drivers) for statistics in (measured, simulated))
    ratios = [wished / found for wished, found in zip(*headways, strict=True)]
    profile = tuple(
        (place, _within(factor * ratio**step, FACTOR_RANGE))
        for (place, factor), ratio in zip(demand.headway_profile, [*ratios, 1.0], strict=True)
    )
    density = (measured.density_veh_per_km_lane / simulated.density_veh_per_km_lane) ** step
    slow = measured.share_below_4mps - simulated.share_below_4mps
    amplitude = (demand.exit_wave_amplitude or FIRST_AMPLITUDE) + AMPLITUDE_GAIN * step * slow
    on_ramp, off_ramp = _improved_ramps(demand, simulated, measured, step)
    return demand.model_copy(
        update={
            "on_ramp_veh_per_h": on_ramp,
            "off_ramp_veh_per_h": off_ramp,
            "density_veh_per_km_lane": _within(demand.density_veh_per_km_lane * density, DENSITY_RANGE, 2),
            "schedule": tuple(
                (from_s, _within(entry * density, DENSITY_RANGE, 2), waves) for from_s, entry, waves in demand.schedule
            ),
            "headway_profile": profile,
            "exit_wave_amplitude": _within(amplitude, AMPLITUDE_RANGE),
        }
    )


def _improved_ramps(
    demand: DemandFile, simulated: PeriodStatistics, measured: PeriodStatistics, step: float
) -> tuple[float | None, float | None]:
    """Return ramp flows that move the flow gained along the road towards the measured one."""
    on_ramp, off_ramp = demand.on_ramp_veh_per_h, demand.off_ramp_veh_per_h
    if on_ramp is None or off_ramp is None:
        return on_ramp, off_ramp
    gains = [entry.quarter_flow_veh_per_h[-1] - entry.quarter_flow_veh_per_h[0] for entry in (measured, simulated)]
    half = RAMP_GAIN * step * (gains[0] - gains[1]) / 2.0
    return _within(on_ramp + half, RAMP_RANGE_VEH_PER_H, 1), _within(off_ramp - half, RAMP_RANGE_VEH_PER_H, 1)


def _scaled(demand: DemandFile, scale: float) -> DemandFile:
    profile = tuple(
        (place, round(scale * factor, 4) if k < QUARTERS else factor)
        for k, (place, factor) in enumerate(demand.headway_profile)
    )
    return demand.model_copy(update={"headway_profile": profile})


def _within(value: float, ends: tuple[float, float], digits: int = 4) -> float:
    return round(float(np.clip(value, *ends)), digits)


def _quarter_headways_s(statistics: PeriodStatistics, drivers: Drivers) -> list[float]:
    return [
        max(0.1, 3600.0 * statistics.lanes * speed / flow - drivers.standing_spacing_m) / speed
        for speed, flow in zip(statistics.quarter_speed_mps, statistics.quarter_flow_veh_per_h, strict=True)
    ]


COMMENT = """\
Made by `python -m harness calibrate --write`; the procedure is in docs/explanation/traffic.md.
It takes the place of what network.toml says about drivers and about demands of these names."""


def as_table(candidate: Candidate) -> dict[str, Any]:
    """Return a candidate as the tables of ``calibration.toml``."""
    return {
        "drivers": candidate.drivers.model_dump(exclude_none=True),
        "demands": {
            name: demand.model_dump(mode="json", exclude_none=True) for name, demand in candidate.demands.items()
        },
    }


def write_candidate(path: Path, candidate: Candidate) -> None:
    """Write a candidate as ``calibration.toml``."""
    write_toml(path, as_table(candidate), COMMENT)
