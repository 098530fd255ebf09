"""Compares simulated with recorded traffic, and writes ``fidelity.json``, ``fidelity.md`` and figures."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import wasserstein_distance

from harness.common.errors import InputError
from harness.common.files import save_figure, write_text, writing
from harness.common.markdown import PagePart, markdown_page, markdown_table, show_markdown
from harness.common.palette import BLUE as SIMULATED
from harness.common.palette import VERMILION as RECORDED
from harness.common.progress import progress_bar
from harness.config.lists import names, seed_values
from harness.lab.fidelity.fields import CELL_M, Fields, read_fields
from harness.lab.fidelity.measured import MeasuredPeriod, MeasuredSite, measure, read_measured
from harness.lab.fidelity.samples import UNITS, BehaviourSamples, merged, recorded_samples, recording_files
from harness.lab.fidelity.simulate import RunJob, SimulatedRun, simulate_all, within
from harness.lab.fidelity.statistics import period_statistics, targets
from harness.truth.network.network import Network, load_network
from mmpf.numerics.arrays import FloatArray

SIDES = ("simulated", "measured")
TARGET_HEADINGS = ("period", "figure", *SIDES, "off by", "allowed", "agrees")
DISTANCE_HEADINGS = ("quantity", "distance", "unit", "sim. mean", "rec. mean", "sim. n", "rec. n")
RATE, RATE_UNIT = "lane_change_rate", "changes per vehicle and km"
FASTEST_SHOWN_MPS = 20.0
BINS = 40


def judge_traffic(options: Mapping[str, Any]) -> dict[str, Any]:
    """Compare simulated with measured traffic, write the result and show it, and return the figures.

    Raises:
        InputError: The network has no measurements or no such demand, a demand was not measured, the runs are too
            short, or a file can't be read or written.
    """
    network, out, duration_s = load_network(str(options["net"] or "us101")), options["out"], 60.0 * options["minutes"]
    site, lanes = read_measured(network), network.main_road.main_lanes
    recorded_fields = None if options["fields"] is None else read_fields(options["fields"])
    if recorded_fields is not None:
        site = measure(site, recorded_fields, lanes)
    demands, seeds = _asked_demands(site, network, options), list(seed_values(options["seeds"]))
    files = recording_files(options["recordings"] or ())
    recorded = recorded_samples(files, network.name) if files else None
    # All of a period in whatever time there is: else other stretches of it would be held against the measured ones.
    scaled = {demand: within(network, demand, site.periods[demand].duration_s, duration_s) for demand in demands}
    jobs = [RunJob(scaled[demand], demand, duration_s, seed) for demand in demands for seed in seeds]
    with progress_bar("fidelity", len(jobs), options["quiet"], before="fidelity: the first simulations") as advance:
        runs = simulate_all(jobs, options["workers"], advance)
    of_demand = {demand: runs[k * len(seeds) : (k + 1) * len(seeds)] for k, demand in enumerate(demands)}
    simulated, left_out = merged(own for _, own in runs), []
    if recorded_fields is None:
        left_out.append("speed fields of the road: the recorded ones are not there; give their folder as `fields`")
    if recorded is None:
        left_out.append("distributions: no recorded vehicles are there; give files or folders as `recordings`")
    table = {
        "net": network.name,
        "source": site.source,
        "seeds": seeds,
        "minutes": options["minutes"],
        "recordings": [file.name for file in files],
        "periods": {name: _period(own, site.periods[name], duration_s, lanes) for name, own in of_demand.items()},
        "distances": {} if recorded is None else distances(simulated, recorded),
        "left_out": left_out,
    }
    with writing("out", out):
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "fidelity.json", json.dumps(table, indent=2) + "\n")
        write_text(out / "fidelity.md", as_markdown(table))
        if recorded_fields is not None:
            for name, own in of_demand.items():
                begin_s = site.periods[name].start_s
                whole = recorded_fields.between(begin_s, begin_s + site.periods[name].duration_s)
                save_figure(speed_fields(name, own[0][0], whole), out / f"speed_field_{name}.png")
        if recorded is not None:
            save_figure(distributions(simulated.by_quantity, recorded.by_quantity), out / "distributions.png")
    if not options["quiet"]:
        show_markdown(as_markdown(table), on_stderr=True)
    return table


def _asked_demands(site: MeasuredSite, network: Network, options: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the demands to be compared, or raise ``InputError``."""
    asked = options["demand"]
    demands = tuple(site.periods) if asked is None else names(asked, "demand", "us101-0805")
    for demand in demands:
        skip_s = site.period(demand).skip_s
        network.demand(demand)
        if 60.0 * options["minutes"] <= skip_s:
            raise InputError(
                f"`minutes` {options['minutes']:g}: the first {skip_s / 60.0:g} of {demand} are left out; give more "
                "than that, 15 for example"
            )
    return demands


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
    return {
        "unit": unit,
        "distance": float(distance),
        **{f"{side}_mean": float(mean) for side, mean in zip(SIDES, means, strict=True)},
        **{f"{side}_n": number for side, number in zip(SIDES, numbers, strict=True)},
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


def as_markdown(table: Mapping[str, Any]) -> str:
    """Return the figures as Markdown."""
    listed = [(demand, target) for demand, period in table["periods"].items() for target in period["targets"]]
    parts: list[PagePart] = [
        f"# How real the traffic on {table['net']} is",
        f"{table['minutes']:g} simulated minutes on each of {len(table['seeds'])} seeds a period; "
        f"the first minutes that the recording undercounts are left out on both sides. Measured: {table['source']}.",
        markdown_table(TARGET_HEADINGS, [_target_row(demand, target) for demand, target in listed]),
        f"{sum(target['met'] for _, target in listed)} of {len(listed)} figures agree with the measured ones within "
        "what is allowed.",
    ]
    if table["distances"]:
        parts += [
            "## Distributions",
            "Wasserstein distances between simulated and recorded vehicles; of the rate, the difference. The "
            "recordings are short windows about single vehicles, from no particular part of the periods: "
            + ", ".join(table["recordings"])
            + ".",
            markdown_table(DISTANCE_HEADINGS, [_distance_row(*entry) for entry in table["distances"].items()]),
        ]
    if table["left_out"]:
        parts += ["## Left out", [f"- {reason}" for reason in table["left_out"]]]
    return markdown_page(parts)


def _target_row(demand: str, target: Mapping[str, Any]) -> tuple[str, ...]:
    unit = " points" if target["unit"] == "points" else " %"
    values = (f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2f}" for value in map(target.__getitem__, SIDES))
    off = f"{target['error']:+.1f}{unit}", f"{target['tolerance']:g}{unit}"
    return demand, target["name"], *values, *off, "yes" if target["met"] else "no"


def _distance_row(quantity: str, entry: Mapping[str, Any]) -> tuple[str, ...]:
    means, numbers = ([entry[f"{side}_{kind}"] for side in SIDES] for kind in ("mean", "n"))
    distance = f"{entry['distance']:.2f}", entry["unit"]
    return quantity.replace("_", " "), *distance, *(f"{mean:.2f}" for mean in means), *map(str, numbers)


def speed_fields(demand: str, simulated: Fields, recorded: Fields) -> Figure:
    """Return both speed fields of a period side by side, on one colour scale."""
    figure = Figure(figsize=(12.0, 4.0), dpi=120, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, fields, title in zip(panels, (recorded, simulated), ("recorded", "simulated, one seed"), strict=True):
        extent = (0.0, fields.duration_s / 60.0, 0.0, fields.speed_mps.shape[0] * CELL_M)
        image = axes.imshow(
            fields.speed_mps,
            origin="lower",
            aspect="auto",
            extent=extent,
            cmap="viridis",
            vmin=0.0,
            vmax=FASTEST_SHOWN_MPS,
            interpolation="nearest",
        )
        axes.set_title(title, loc="left", fontsize=10)
        axes.set_xlabel("time, minutes")
    panels[0].set_ylabel("position along the road, m (traffic moves up)")
    figure.colorbar(image, ax=list(panels), label="speed, m/s", extend="max")
    figure.suptitle(f"{demand}: speed of all lanes over road and time", fontsize=11)
    return figure


def distributions(simulated: dict[str, FloatArray], recorded: dict[str, FloatArray]) -> Figure:
    """Return the distribution of every quantity, both sides, one panel each."""
    figure = Figure(figsize=(13.0, 6.0), dpi=120, layout="constrained")
    panels = figure.subplots(2, 4)
    for axes, (quantity, unit) in zip(panels.flat, UNITS.items(), strict=True):
        first, second = simulated[quantity], recorded[quantity]
        axes.set_xlabel(f"{quantity.replace('_', ' ')}, {unit}")
        axes.set_yticks([])
        axes.spines[["top", "right", "left"]].set_visible(False)
        if not len(first) or not len(second):
            axes.annotate("no samples", (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.4")
            continue
        low, high = np.quantile(np.concatenate([first, second]), [0.002, 0.998])
        edges = np.linspace(low, high, BINS + 1)
        for values, colour in ((first, SIMULATED), (second, RECORDED)):
            axes.hist(values, bins=edges, density=True, histtype="step", color=colour, linewidth=1.6)
    for height, text, colour in ((0.95, "simulated", SIMULATED), (0.85, "recorded", RECORDED)):
        panels[0, 0].annotate(text, (0.98, height), xycoords="axes fraction", color=colour, ha="right", va="top")
    for axes in panels[:, 0]:
        axes.set_ylabel("share of samples")
    return figure
