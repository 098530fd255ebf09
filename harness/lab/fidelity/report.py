"""Writes a comparison as ``fidelity.json``, ``fidelity.md`` and figures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from harness.common.errors import InputError
from harness.common.files import save_figure, write_text
from harness.common.markdown import markdown_table
from harness.lab.fidelity.comparison import Distance, Fidelity, Period
from harness.lab.fidelity.fields import CELL_M, Fields
from harness.lab.fidelity.samples import UNITS
from harness.lab.fidelity.statistics import Target
from mmpf.numerics.arrays import FloatArray

TARGET_HEADINGS = ("period", "figure", "simulated", "measured", "off by", "allowed", "agrees")
DISTANCE_HEADINGS = ("quantity", "distance", "unit", "sim. mean", "rec. mean", "sim. n", "rec. n")
# Okabe and Ito's blue and vermilion.
SIMULATED, RECORDED = "#0072B2", "#D55E00"
FASTEST_SHOWN_MPS = 20.0
BINS = 40


def write_fidelity(result: Fidelity, folder: Path) -> None:
    """Write the result into a folder.

    Raises:
        InputError: The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "fidelity.json", json.dumps(result.as_json(), indent=2) + "\n")
        write_text(folder / "fidelity.md", as_markdown(result))
        for name, figure in draw_figures(result).items():
            save_figure(figure, folder / f"{name}.png")
    except OSError as error:
        raise InputError(f"`out` {folder}: cannot be written: {error.strerror}") from error


def as_markdown(result: Fidelity) -> str:
    """Return the result as Markdown."""
    targets = [_target_row(period, target) for period in result.periods for target in period.targets]
    lines = [
        f"# How real the traffic on {result.network} is",
        "",
        f"{result.setting['minutes']:g} simulated minutes on each of {len(result.setting['seeds'])} seeds a period; "
        f"the first minutes that the recording undercounts are left out on both sides. Measured: {result.source}.",
        "",
        *markdown_table(TARGET_HEADINGS, targets),
        "",
        summary(result),
        "",
    ]
    if result.distances:
        lines += [
            "## Distributions",
            "",
            "Wasserstein distances between simulated and recorded vehicles; of the rate, the difference. The "
            "recordings are short windows about single vehicles, from no particular part of the periods: "
            + ", ".join(result.setting["recordings"])
            + ".",
            "",
            *markdown_table(DISTANCE_HEADINGS, [_distance_row(entry) for entry in result.distances]),
            "",
        ]
    if result.left_out:
        lines += ["## Left out", "", *(f"- {reason}" for reason in result.left_out), ""]
    return "\n".join(lines)


def summary(result: Fidelity) -> str:
    """Return in one sentence how many figures agree."""
    listed = [target for period in result.periods for target in period.targets]
    agree = f"{sum(target.met for target in listed)} of {len(listed)} figures agree"
    return f"{agree} with the measured ones within what is allowed."


def _target_row(period: Period, target: Target) -> tuple[str, ...]:
    unit = " points" if target.unit == "points" else " %"
    return (
        period.demand,
        target.name,
        _digits(target.simulated),
        _digits(target.measured),
        f"{target.error:+.1f}{unit}",
        f"{target.tolerance:g}{unit}",
        "yes" if target.met else "no",
    )


def _distance_row(entry: Distance) -> tuple[str, ...]:
    return (
        entry.quantity.replace("_", " "),
        f"{entry.distance:.2f}",
        entry.unit,
        f"{entry.simulated_mean:.2f}",
        f"{entry.measured_mean:.2f}",
        str(entry.simulated_n),
        str(entry.measured_n),
    )


def _digits(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2f}"


def draw_figures(result: Fidelity) -> dict[str, Figure]:
    """Return the figures by file name; those that lack recorded data are not among them."""
    figures = {}
    for period in result.periods:
        simulated, recorded = period.fields
        if recorded is not None:
            figures[f"speed_field_{period.demand}"] = speed_fields(period.demand, simulated, recorded)
    if result.samples is not None:
        simulated_samples, recorded_samples = result.samples
        figures["distributions"] = distributions(simulated_samples.values, recorded_samples.values)
    return figures


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
