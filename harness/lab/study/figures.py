"""The studies' figures: particles over time with the truth, and mean errors over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.common.files import save_figure
from harness.common.plots import label_ends
from harness.lab.study.study import StudyResult
from harness.lab.windows.scores import mean_with_interval
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
ERROR_PANELS = {
    "lane-keeping": (("lon_m", "longitudinal position, m"), ("speed_mps", "longitudinal speed, m/s")),
    "lane-change": (
        ("lon_m", "longitudinal position, m"),
        ("speed_mps", "longitudinal speed, m/s"),
        ("lat_m", "lateral position, m"),
        ("lat_speed_mps", "lateral speed, m/s"),
    ),
}
DRAW_EVERY = 4
BAND_EVERY = 5


def draw_study(result: StudyResult, folder: Path) -> list[Path]:
    """Draw all pictures of a study and return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for occlusion in result.occlusions():
        for kind, figure in (("particles", particles_figure), ("errors", errors_figure)):
            path = folder / f"{result.study}-{occlusion}-{kind}.png"
            save_figure(figure(result, occlusion), path, dpi=110)
            paths.append(path)
    return paths


def particles_figure(result: StudyResult, occlusion: str) -> Figure:
    """Draw the example case after the paper's figures 2, 3 and 6: a column for each model, a row for each quantity."""
    models = [model for model in SHOWN[result.study] if (occlusion, model) in result.examples]
    panels = LON_PANELS if result.study == "lane-keeping" else (*LON_PANELS, *LAT_PANELS)
    figure = Figure(figsize=(2.5 * len(models) + 0.8, 2.2 * len(panels) + 0.7), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(panels), len(models), sharex=True, sharey="row", squeeze=False))
    for column, model in enumerate(models):
        for row, panel in enumerate(panels):
            _particles(axes[row, column], result, occlusion, model, panel)
        axes[0, column].set_title(model, fontsize=10)
        axes[-1, column].set_xlabel("time, s")
    for row, (_, _, label) in enumerate(panels):
        axes[row, 0].set_ylabel(label)
        _bound_by_truth_and_particles(axes[row, 0], result, occlusion, models, panels[row])
    figure.suptitle(f"{result.study}, {occlusion} occlusion, one case: particles (dots) and truth (line)", fontsize=10)
    return figure


def errors_figure(result: StudyResult, occlusion: str) -> Figure:
    """Draw the mean absolute error over time after the paper's figures 4 and 7, with 95 % intervals over cases."""
    panels = ERROR_PANELS[result.study]
    rows = len(panels) // 2
    figure = Figure(figsize=(10.0, 3.8 * rows), layout="constrained")
    for axis, (quantity, label) in zip(figure.subplots(rows, 2, squeeze=False).ravel(), panels, strict=True):
        _errors(axis, result, occlusion, quantity)
        axis.set_xlabel("time, s")
        axis.set_ylabel(f"MAE of {label}")
    cases = next(iter(result.scores.values())).crps_m.shape[1]
    figure.suptitle(f"{result.study}, {occlusion} occlusion: mean of {cases} cases, 95 % intervals shaded", fontsize=10)
    return figure


def _particles(axis: Axes, result: StudyResult, occlusion: str, model: str, panel: tuple[int, int, str]) -> None:
    row, kept_row, _ = panel
    truth, reference = result.example_truth, _reference(result, row)
    time_s = np.arange(len(truth)) * result.step_s
    values = result.examples[occlusion, model][:, kept_row]
    shown = slice(DRAW_EVERY - 1, None, DRAW_EVERY)
    times = np.repeat(time_s[1:][shown, None], values.shape[1], axis=1)
    relative = values[shown] - reference[1:][shown, None]
    axis.plot(times.ravel(), relative.ravel(), ".", color="#0072B2", markersize=1.5, alpha=0.35, rasterized=True)
    axis.plot(time_s, truth[:, row] - reference, color="#D55E00", linewidth=1.6)
    axis.spines[["top", "right"]].set_visible(False)


def _bound_by_truth_and_particles(
    axis: Axes, result: StudyResult, occlusion: str, models: list[str], panel: tuple[int, int, str]
) -> None:
    """Hold the shared axis to what 90 % of the particles reach, so that one model's runaways don't flatten the rest."""
    row, kept_row, _ = panel
    truth, reference = result.example_truth, _reference(result, row)
    clouds = [result.examples[occlusion, model][:, kept_row] - reference[1:, None] for model in models]
    low = min([np.quantile(cloud, 0.02) for cloud in clouds] + [(truth[:, row] - reference).min()])
    high = max([np.quantile(cloud, 0.98) for cloud in clouds] + [(truth[:, row] - reference).max()])
    axis.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))


def _reference(result: StudyResult, row: int) -> FloatArray:
    """Return what a quantity is drawn against: steady driving for the position, zero for all others."""
    truth = result.example_truth
    steady = truth[0, LON] + truth[0, SPEED] * result.step_s * np.arange(len(truth))
    return np.asarray(steady if row == LON else np.zeros(len(truth)))


def _errors(axis: Axes, result: StudyResult, occlusion: str, quantity: str) -> None:
    ends = []
    for model in result.models():
        error = result.scores[occlusion, model].abs_error[quantity]
        time_s = np.arange(1, len(error) + 1) * result.step_s
        mean = error.mean(axis=1)
        shown = np.unique(np.append(np.arange(0, len(error), BAND_EVERY), len(error) - 1))
        band = np.array([mean_with_interval(error[step], np.random.default_rng(0))[1] for step in shown])
        colour = COLOURS.get(model, "#777777")
        axis.fill_between(time_s[shown], band[:, 0], band[:, 1], color=colour, alpha=0.18, linewidth=0)
        axis.plot(time_s, mean, color=colour, linewidth=2.0 if model in ("residual", "gmm") else 1.3)
        ends.append((float(mean[-1]), model, colour))
    label_ends(axis, ends, time_s[-1])
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_ylim(bottom=0.0)
    axis.set_xlim(0.0, time_s[-1])
