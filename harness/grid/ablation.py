"""The ablation study: what each departure from the paper's rule is worth, one taken back at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.grid.grid import GridRequest
from harness.scoring.statistics import independent_ci
from harness.writing.files import write_results
from harness.writing.markdown import markdown_table
from mmpf.compute.arrays import FloatArray

DEFAULT = "mmpf"
DRAWS = 2000


@dataclass(frozen=True)
class Ablation:
    """One arm of the study.

    Attributes:
        variant: The tracker as ``stress --trackers`` takes it.
        what: What is different from the default, in words.
    """

    variant: str
    what: str


@dataclass(frozen=True)
class Measure:
    """One column of the table.

    Attributes:
        key: Column of ``runs.parquet``.
        name: Heading.
        decimals: Digits after the point.
    """

    key: str
    name: str
    decimals: int


ABLATIONS = (
    Ablation(DEFAULT, "the default: soft joint association"),
    Ablation("mmpf+joint.shadow=false", "detection probability the same everywhere, blind to shadows"),
    Ablation("mmpf+joint.exclusive=false", "a detection may serve several components (no belief propagation)"),
    Ablation("mmpf+joint.stitch=false", "no identity handed to a component confirmed near a hidden one"),
    Ablation("mmpf+joint.missed_detection_cap=0.95", "misses taken as independent in time (cap 0.95 for 0.6)"),
    Ablation("mmpf+joint.exclusion_strength=0", "hidden particles may lie on seen vehicles"),
    Ablation("mmpf+joint.kernel_width=0", "resampled particles are copies, not smoothed by a kernel"),
    Ablation("mmpf+joint.young_hits=0", "young components resampled like all others, not from a Gaussian"),
    Ablation("mmpf+birth.other_speed_std_mps=2.5", "newborn speeds near the neighbours' only"),
    Ablation("mmpf+model_error.speed=0+model_error.accel=0+model_error.lat_speed=0", "no noise beside the model's own"),
    Ablation("mmpf+update=max_likelihood", "the paper's rule as it is written"),
    Ablation("mmpf+update=max_likelihood+max_likelihood.gate_std=6", "the paper's rule, no update without a detection"),
    Ablation(
        "mmpf+update=max_likelihood+max_likelihood.floor_component_weight=0.01",
        "the paper's rule, component weights kept from starving",
    ),
)
MEASURES = (
    Measure("mot.hota", "HOTA in sight, %", 1),
    Measure("mot.idf1", "IDF1 in sight, %", 1),
    Measure("mot.id_switches", "identity switches a run", 1),
    Measure("mot_all.idf1", "IDF1, seen within 10 s, %", 1),
    Measure("mot_all.false_tracks_per_scan", "false tracks a scan, all", 2),
    Measure("occlusion.short.same_id_percent", "same identity, hidden to 3 s, %", 0),
    Measure("occlusion.long.same_id_percent", "same identity, hidden 3-10 s, %", 0),
    Measure("mae.hidden.lon_m", "longitudinal error, hidden, m", 2),
)


def ablation_request(net: str, seeds: str, duration_s: float) -> GridRequest:
    """Return the grid of all arms in dense traffic, where association is hard."""
    variants = ",".join(ablation.variant for ablation in ABLATIONS)
    return GridRequest(net=net, densities="45", trackers=variants, seeds=seeds, duration_s=duration_s)


def ablation_rows(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Return mean and paired difference from the default for each arm and measure.

    Args:
        runs: Rows of a grid of ``ablation_request``.

    Returns:
        One row per arm: variant, what, runs, and for each measure ``mean``, ``difference`` and its 95 % bootstrap
        interval over seeds ``ci95``, None where nothing was measured.
    """
    finished = runs[runs["succeeded"]]
    default = finished[finished["variant"] == DEFAULT].set_index("seed")
    rows = []
    for ablation in ABLATIONS:
        own = finished[finished["variant"] == ablation.variant].set_index("seed")
        row: dict[str, Any] = {"variant": ablation.variant, "what": ablation.what, "runs": len(own)}
        for measure in MEASURES:
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
    heading = ["tracker", "what is different", *(measure.name for measure in MEASURES)]
    table = [[f"`{row['variant']}`", row["what"], *(_cell(row, measure) for measure in MEASURES)] for row in rows]
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


def _cell(row: dict[str, Any], measure: Measure) -> str:
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
