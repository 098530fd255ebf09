"""The studies' figures: particles over time with the truth, and mean errors over time."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.common.charts import Charts, curves, draw_charts
from harness.common.files import save_figure
from harness.common.intervals import clustered_ci
from harness.common.numbers import without_nan
from harness.lab.study.study import StudyResult
from harness.truth.frame import STEP_S
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray

COLOURS = {
    "residual": "#B22222",
    "empirical": "#9467BD",
    "gmm": "#0072B2",
    "gmm-short": "#56B4E9",
    "gmm-lane-change": "#56B4E9",
    "idm": "#D55E00",
    "idm-fitted": "#E69F00",
    "idm-adaptive": "#7F7F7F",
    "cvm": "#000000",
    "cam": "#009E73",
    "csav": "#CC79A7",
    "csaa": "#8C6D1F",
}
SHOWN = {
    "lane-keeping": ("residual", "gmm", "gmm-short", "cvm", "idm"),
    "lane-change": ("gmm", "gmm-lane-change", "cvm", "cam"),
}
LON_PANELS = ((LON, 0, "position against steady\nspeed, m"), (SPEED, 2, "speed, m/s"))
LAT_PANELS = ((LAT, 1, "lateral position, m"), (LAT_SPEED, 3, "lateral speed, m/s"))
LON_ERRORS = (("lon_m", "longitudinal position, m"), ("speed_mps", "longitudinal speed, m/s"))
LAT_ERRORS = (("lat_m", "lateral position, m"), ("lat_speed_mps", "lateral speed, m/s"))
ERROR_PANELS = {"lane-keeping": LON_ERRORS, "lane-change": (*LON_ERRORS, *LAT_ERRORS)}
DRAW_EVERY = 4
ERRORS_EVERY = 5


def draw_study(result: StudyResult, folder: Path) -> list[Path]:
    """Draw all pictures of a study and return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for occlusion in result.occlusions():
        particles, errors = (folder / f"{result.study}-{occlusion}-{kind}.png" for kind in ("particles", "errors"))
        save_figure(particles_figure(result, occlusion), particles, dpi=110)
        draw_charts(error_charts(result, occlusion), f"{result.study}, {occlusion} occlusion", errors)
        paths += [particles, errors]
    return paths


def particles_figure(result: StudyResult, occlusion: str) -> Figure:
    """Draw the example case after the paper's figures 2, 3 and 6: a column for each model, a row for each quantity."""
    models = [model for model in SHOWN[result.study] if (occlusion, model) in result.examples]
    panels = LON_PANELS if result.study == "lane-keeping" else (*LON_PANELS, *LAT_PANELS)
    figure = Figure(figsize=(2.5 * len(models) + 0.8, 2.2 * len(panels) + 0.7), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(panels), len(models), sharex=True, sharey="row", squeeze=False))
    for column, model in enumerate(models):
        axes[0, column].set_title(model, fontsize=10)
        axes[-1, column].set_xlabel("time, s")
    for row, (quantity, kept, label) in enumerate(panels):
        reference = _reference(result, quantity)
        true = result.example_truth[:, quantity] - reference
        clouds = [result.examples[occlusion, model][:, kept] - reference[1:, None] for model in models]
        for axis, cloud in zip(axes[row], clouds, strict=True):
            _draw_particles(axis, cloud, true)
        axes[row, 0].set_ylabel(label)
        # The shared axis holds 96 % of each model's particles, so that one model's runaways don't flatten the rest.
        low = min(true.min(), *(np.quantile(cloud, 0.02) for cloud in clouds))
        high = max(true.max(), *(np.quantile(cloud, 0.98) for cloud in clouds))
        axes[row, 0].set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    figure.suptitle(f"{result.study}, {occlusion} occlusion, one case: particles (dots) and truth (line)", fontsize=10)
    return figure


def error_charts(result: StudyResult, occlusion: str) -> Charts:
    """Return the mean absolute error over time after the paper's figures 4 and 7, some with 95 % intervals."""
    lines = tuple((model, COLOURS.get(model, "#332288")) for model in result.models())
    charts = []
    for quantity, label in ERROR_PANELS[result.study]:
        title = f"MAE of {label}"
        rows = [row for model in result.models() for row in _errors(result, occlusion, model, quantity)]
        tooltip = (("series", "model"), ("place", "time, s"), ("mean", title))
        charts.append(curves(title, f"{title}, over time, by model", "time, s", rows, lines, tooltip))
    cases = next(iter(result.scores.values())).crps_m.shape[1]
    return Charts(
        tuple(charts),
        lines,
        f"Means of {cases} cases; 95 % intervals, over recordings, of {', '.join(SHOWN[result.study])}.",
    )


def _draw_particles(axis: Axes, cloud: FloatArray, true: FloatArray) -> None:
    """Draw particles after each step, shape (steps - 1, shown), and the truth, shape (steps,)."""
    time_s = np.arange(len(true)) * STEP_S
    shown = slice(DRAW_EVERY - 1, None, DRAW_EVERY)
    times = np.repeat(time_s[1:][shown, None], cloud.shape[1], axis=1)
    axis.plot(times.ravel(), cloud[shown].ravel(), ".", color="#0072B2", markersize=1.5, alpha=0.35, rasterized=True)
    axis.plot(time_s, true, color="#D55E00", linewidth=1.6)
    axis.spines[["top", "right"]].set_visible(False)


def _reference(result: StudyResult, row: int) -> FloatArray:
    """Return what a quantity is drawn against: steady driving for the position, zero for all others."""
    truth = result.example_truth
    steady = truth[0, LON] + truth[0, SPEED] * STEP_S * np.arange(len(truth))
    return np.asarray(steady if row == LON else np.zeros(len(truth)))


def _errors(result: StudyResult, occlusion: str, model: str, quantity: str) -> Iterator[dict[str, Any]]:
    scores = result.scores[occlusion, model]
    error = scores.abs_error[quantity]
    for step in np.unique(np.append(np.arange(0, len(error), ERRORS_EVERY), len(error) - 1)):
        shown = model in SHOWN[result.study]  # bands of all models would hide each other
        band = without_nan(asdict(clustered_ci(error[step], scores.traffic))) if shown else {"low": None, "high": None}
        yield {"series": model, "place": float((step + 1) * STEP_S), "mean": float(error[step].mean())} | band
