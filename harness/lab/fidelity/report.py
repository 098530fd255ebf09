"""Writes a comparison as ``fidelity.json``, ``fidelity.md`` and figures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from harness.common.files import save_figure, write_text, writing
from harness.common.markdown import markdown_table, show_markdown
from harness.lab.fidelity.comparison import compare_traffic
from harness.lab.fidelity.fields import CELL_M, Fields
from harness.lab.fidelity.options import FidelityOptions
from harness.lab.fidelity.samples import UNITS
from harness.truth.network.network import load_network
from mmpf.numerics.arrays import FloatArray

TARGET_HEADINGS = ("period", "figure", "simulated", "measured", "off by", "allowed", "agrees")
SIDES = ("simulated", "measured")
DISTANCE_HEADINGS = ("quantity", "distance", "unit", "sim. mean", "rec. mean", "sim. n", "rec. n")
# Okabe and Ito's blue and vermilion.
SIMULATED, RECORDED = "#0072B2", "#D55E00"
FASTEST_SHOWN_MPS = 20.0
BINS = 40


def judge_traffic(options: FidelityOptions) -> dict[str, Any]:
    """Compare simulated with measured traffic, write the result and show it, and return the figures.

    Raises:
        InputError: The network has no measurements, a demand was not measured, or a file can't be read or written.
    """
    network, out = load_network(str(options["net"] or "us101")), options["out"]
    table, fields, samples = compare_traffic(network, options)
    with writing("out", out):
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "fidelity.json", json.dumps(table, indent=2) + "\n")
        write_text(out / "fidelity.md", as_markdown(table))
        for demand, (simulated, recorded) in fields.items():
            save_figure(speed_fields(demand, simulated, recorded), out / f"speed_field_{demand}.png")
        if samples is not None:
            save_figure(distributions(*(side.by_quantity for side in samples)), out / "distributions.png")
    if not options["quiet"]:
        show_markdown(as_markdown(table), on_stderr=True)
    return table


def as_markdown(table: Mapping[str, Any]) -> str:
    """Return the figures as Markdown."""
    listed = [(demand, target) for demand, period in table["periods"].items() for target in period["targets"]]
    lines = [
        f"# How real the traffic on {table['net']} is",
        "",
        f"{table['minutes']:g} simulated minutes on each of {len(table['seeds'])} seeds a period; "
        f"the first minutes that the recording undercounts are left out on both sides. Measured: {table['source']}.",
        "",
        *markdown_table(TARGET_HEADINGS, [_target_row(demand, target) for demand, target in listed]),
        "",
        f"{sum(target['met'] for _, target in listed)} of {len(listed)} figures agree with the measured ones within "
        "what is allowed.",
        "",
    ]
    if table["distances"]:
        lines += [
            "## Distributions",
            "",
            "Wasserstein distances between simulated and recorded vehicles; of the rate, the difference. The "
            "recordings are short windows about single vehicles, from no particular part of the periods: "
            + ", ".join(table["recordings"])
            + ".",
            "",
            *markdown_table(DISTANCE_HEADINGS, [_distance_row(*entry) for entry in table["distances"].items()]),
            "",
        ]
    if table["left_out"]:
        lines += ["## Left out", "", *(f"- {reason}" for reason in table["left_out"]), ""]
    return "\n".join(lines)


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
