"""The ablation study: what each departure from the paper's rule is worth, one taken back at a time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.grid.grid import GridRequest
from harness.scoring.metrics import quantities
from harness.scoring.quantity import Quantity
from harness.scoring.statistics import independent_ci
from harness.writing.files import write_results
from harness.writing.markdown import markdown_table
from mmpf.compute.arrays import FloatArray

DEFAULT = "mmpf"
DRAWS = 2000


ABLATIONS = {
    DEFAULT: "the default: soft joint association",
    "mmpf+joint.detectability.shadow=false": "detection probability the same everywhere, blind to shadows",
    "mmpf+joint.association.exclusive=false": "a detection may serve several components (no belief propagation)",
    "mmpf+joint.identity.stitch=false": "no identity handed to a component confirmed near a hidden one",
    "mmpf+joint.detectability.missed_cap=0.95": "misses taken as independent in time (cap 0.95 for 0.6)",
    "mmpf+joint.association.exclusion_per_s=0": "hidden particles may lie on seen vehicles",
    "mmpf+joint.resampling.kernel_width=0": "resampled particles are copies, not smoothed by a kernel",
    "mmpf+joint.resampling.young_hits=0": "young components resampled like all others, not from a Gaussian",
    "mmpf+birth.other_speed_std_mps=2.5": "newborn speeds near the neighbours' only",
    "mmpf+model_error.speed=0+model_error.accel=0+model_error.lat_speed=0": "no noise beside the model's own",
    "mmpf+update=max_likelihood": "the paper's rule as it is written",
    "mmpf+update=max_likelihood+max_likelihood.association.gate_std=6": (
        "the paper's rule, no update without a detection"
    ),
    "mmpf+update=max_likelihood+max_likelihood.existence.floor_weight=0.01": (
        "the paper's rule, component weights kept from starving"
    ),
}
"""What is different from the default in each arm, by its tracker as ``trackers`` of a stress test takes it."""


def ablated_quantities() -> list[Quantity]:
    """Return the columns of the table: multi-object scores first, then identities, then the rest."""
    return [quantity for quantity in quantities("mot", "mot_all", "occlusion") if quantity.ablated]


def ablation_request(net: str, seeds: str, duration_s: float) -> GridRequest:
    """Return the grid of all arms in dense traffic, where association is hard."""
    return GridRequest(net=net, densities="45", trackers=",".join(ABLATIONS), seeds=seeds, duration_s=duration_s)


def ablation_rows(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Return mean and paired difference from the default for each arm and measure.

    Args:
        runs: Rows of a grid of ``ablation_request``.

    Returns:
        One row per arm: variant, what, runs, and for each measure ``mean``, ``difference`` and its 95 % bootstrap
        interval over seeds ``ci95``, None where nothing was measured.
    """
    measures = ablated_quantities()
    finished = runs[runs["succeeded"]].reindex(columns=["variant", "seed", *(measure.key for measure in measures)])
    default = finished[finished["variant"] == DEFAULT].set_index("seed")
    rows = []
    for variant, what in ABLATIONS.items():
        own = finished[finished["variant"] == variant].set_index("seed")
        row: dict[str, Any] = {"variant": variant, "what": what, "runs": len(own)}
        for measure in measures:
            values = own[measure.key].astype(float)
            difference = np.asarray((values - default[measure.key].astype(float)).dropna(), dtype=np.float64)
            row[measure.key] = {
                "mean": _number(values.mean()),
                "difference": _number(difference.mean()) if len(difference) else None,
                "ci95": _interval(difference),
            }
        rows.append(row)
    return rows


def as_markdown(rows: Sequence[dict[str, Any]], setting: str) -> str:
    """Return the table: means, and in brackets how far each arm is from the default."""
    measures = ablated_quantities()
    heading = ["tracker", "what is different", *(measure.label for measure in measures)]
    table = [[f"`{row['variant']}`", row["what"], *(_cell(row, measure) for measure in measures)] for row in rows]
    lines = [
        "# Ablation: what each departure from the paper is worth",
        "",
        setting,
        "",
        "Each cell: mean over seeds, and the paired difference from the default with its 95 % bootstrap interval over",
        "seeds. All arms saw the same detections. The error of hidden vehicles counts only while they are followed: an",
        "arm that soon lets go of them has a small one.",
        "",
        *markdown_table(heading, table),
        "",
    ]
    return "\n".join(lines)


def write_ablation(rows: Sequence[dict[str, Any]], setting: str, folder: Path) -> dict[str, Any]:
    """Write ``results.json`` and ``results.md`` and return what the former holds."""
    content = {"study": "ablation", "setting": setting, "results": list(rows)}
    write_results(folder, content, as_markdown(rows, setting))
    return content


def _cell(row: dict[str, Any], measure: Quantity) -> str:
    entry = row[measure.key]
    if entry["mean"] is None:
        return "-"
    text = f"{entry['mean']:.{measure.decimals}f}"
    if row["variant"] == DEFAULT or entry["ci95"] is None:
        return text
    low, high = entry["ci95"]
    digits = f"+.{measure.decimals}f"
    return f"{text} ({entry['difference']:{digits}} [{low:{digits}}, {high:{digits}}])"


def _interval(differences: FloatArray) -> tuple[float, float] | None:
    if len(differences) < 2:
        return None
    interval = independent_ci(differences, np.random.default_rng(0), DRAWS)
    return round(interval.low, 4), round(interval.high, 4)


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
