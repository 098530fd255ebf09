"""The ablation study: the effect of each departure from the paper's rule, undone one at a time."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from harness.common.effects import paired_effect
from harness.common.markdown import PagePart, markdown_page, markdown_table
from harness.grid.grid import GridRequest
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import view
from mmpf.numerics.arrays import FloatArray

DEFAULT = "mmpf"
PAPER = "mmpf+update=max_likelihood"
CHARITABLE = f"{PAPER}+max_likelihood.reading=charitable"
GATE = "max_likelihood.association.gate_std=3"
FLOOR = "max_likelihood.existence.floor_weight=1"
ANEW = "max_likelihood.existence.weights_anew=true"
TOUCH = (
    "max_likelihood.reclustering.lon_m=3+max_likelihood.reclustering.lat_m=1.2+max_likelihood.reclustering.alike=true"
)
SHADED, NO_PATH = "shading=[1,1e-9,1e-9]", "mmpf+joint.path.gap_m=0+joint.path.reaction_s=0+joint.path.braking_mps2=1e9"
KEEPING_MODEL, BOTH_MODELS = "model=gmm-short", "model=gsm"

ABLATIONS = {
    DEFAULT: "the default: soft joint association",
    "mmpf+joint.detectability.shadow=false": "detection probability the same everywhere, blind to shadows",
    "mmpf+joint.association.exclusive=false": "a detection may serve several components (no belief propagation)",
    "mmpf+joint.identity.stitch=false": "no identity handed to a component confirmed near a hidden one",
    "mmpf+joint.detectability.run_share=0": "misses taken as independent in time, not in runs",
    "mmpf+joint.kinds.weighed=false": "everything that exists is a vehicle, no lasting false objects",
    "mmpf+joint.vehicles.detectability=[0,0,0,0,0,0,1]": "all vehicles equally well detectable",
    f"mmpf+joint.vehicles.{SHADED}+joint.false_objects.{SHADED}": "shadows hide all sources alike",
    "mmpf+joint.newborn.overlooked_share=0": "who is first detected in plain view had not been overlooked before",
    NO_PATH: "what lies in the ego's path is reported like all else",
    "mmpf+joint.false_objects.prior_count=1e9+joint.false_objects.prior_watched_s=1e9": "false objects not learned",
    "mmpf+joint.speeds.stopped_on_road=0": "along a road no vehicle stands where others flow",
    "mmpf+joint.manoeuvres.begin_per_s=0": "drivers in sight do nothing that the motion model does not foresee",
    "mmpf+joint.noise.learned=false": "detections as noisy as they report themselves",
    "mmpf+joint.reach.learned=false": "detects as well at every distance as the data sheet says, not counted",
    "mmpf+joint.association.clutter_memory_s=inf": "as much clutter as the data sheet says, not counted",
    "mmpf+joint.association.exclusion_per_s=0": "hidden particles may lie on seen vehicles",
    "mmpf+joint.resampling.kernel_width=0": "resampled particles are copies, not smoothed by a kernel",
    "mmpf+joint.resampling.young_s=0": "young components resampled like all others, not from a Gaussian",
    "mmpf+birth.other_speed_std_mps=2.5": "newborn speeds near the neighbours' only",
    "mmpf+model_error.speed=0+model_error.accel=0+model_error.lat_speed=0": "no noise in addition to the model's own",
    PAPER: "the paper's rule, read literally",
    f"{PAPER}+{GATE}": "literal, no update without a detection within three deviations",
    f"{PAPER}+{FLOOR}": "literal, component weights kept alike",
    f"{PAPER}+{GATE}+{FLOOR}": "literal, that gate and alike weights together",
    f"{PAPER}+{GATE}+{ANEW}": "literal, with that gate and equation (11) restarted in each scan",
    f"{PAPER}+{GATE}+{ANEW}+{TOUCH}": "literal, both and k-medoids where footprints touch, votes alike",
    CHARITABLE: "the paper's rule, read charitably",
    f"{CHARITABLE}+max_likelihood.association.gate_std=inf": "charitable, without the gate",
    f"{CHARITABLE}+max_likelihood.existence.weights_anew=false": "charitable, component weights multiplied over time",
    f"{CHARITABLE}+max_likelihood.reclustering.alike=false": "charitable, particles vote by their weights",
    f"{CHARITABLE}+max_likelihood.merging.keep_seen=false": "charitable, the elder's name stays in a merge",
    f"{CHARITABLE}+max_likelihood.removal.unconfirmed_unseen_s=10": "charitable, unconfirmed ones live on",
    f"{PAPER}+{KEEPING_MODEL}": "literal, the paper's own 28 components for lane keeping",
    f"{PAPER}+{BOTH_MODELS}": "literal, the paper's own 28 and 60 components",
    f"{CHARITABLE}+{KEEPING_MODEL}": "charitable, the paper's own 28 components for lane keeping",
    f"{CHARITABLE}+{BOTH_MODELS}": "charitable, the paper's own 28 and 60 components",
}
"""What is different from the default in each arm, by its tracker as ``trackers`` of a stress test takes it."""

IDEAL_ABLATIONS = {arm: what for arm, what in ABLATIONS.items() if arm == DEFAULT or arm.startswith(PAPER)}
"""The arms that are run under the paper's own sensor too: the default, and the paper's rule however it is read."""
IDEAL_SENSOR = "ideal"
"""Profile of the paper's sensor: who is not hidden is detected, and nothing else."""

COLUMNS = (
    *("hidden.hidden_cost_m", "hidden.false_hidden_tracks_per_scan", "mot.hota", "mot.idf1", "mot.id_switches"),
    *("mot_all.idf1", "mot_all.false_tracks_per_scan"),
    *("occlusion.short.same_id_percent", "occlusion.long.same_id_percent"),
    *("mae.hidden.lon_m", "mae.hidden.followed_percent", "in_plain_view.recall", "in_plain_view.worst_tenth"),
)


def ablated_quantities() -> list[Quantity]:
    """Return the columns of the table."""
    return view(COLUMNS, {"mot.id_switches": {"label": "identity switches a run", "decimals": 1}})


def ablation_request(
    net: str, seeds: str, duration_s: float, arms: Mapping[str, str] = ABLATIONS, sensor: str | None = None
) -> GridRequest:
    """Return the grid of some arms in dense traffic, where association is hard."""
    return GridRequest(
        net=net, densities="45", trackers=",".join(arms), seeds=seeds, duration_s=duration_s, sensor=sensor
    )


def ablation_rows(runs: pd.DataFrame, arms: Mapping[str, str] = ABLATIONS) -> list[dict[str, Any]]:
    """Return mean and paired difference from the default for each arm and measure.

    Returns:
        One row per arm: variant, what, runs, and for each measure ``mean``, ``difference`` and its 95 % interval
        ``ci95`` (Student's, over seeds), None where nothing was measured.
    """
    measures = ablated_quantities()
    finished = runs[runs["succeeded"]].reindex(columns=["variant", "seed", *(measure.key for measure in measures)])
    default = finished[finished["variant"] == DEFAULT].set_index("seed")
    rows = []
    for variant, what in arms.items():
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


def as_markdown(rows: Sequence[dict[str, Any]], ideal: Sequence[dict[str, Any]], setting: str) -> str:
    """Return the tables: means, and in brackets how far each arm is from the default."""
    parts: list[PagePart] = [
        "# Ablation: what each departure from the paper is worth",
        setting,
        "Each cell: mean over seeds, and the paired difference from the default with its 95 % interval over seeds.\n"
        "All arms of a table saw the same detections. The hidden cost is over all vehicles hidden after seen,\n"
        "10 m for vehicles without a track; the error of hidden vehicles covers tracked vehicles only, and their share "
        "is listed.",
        _table(rows),
        "## Under the paper's sensor",
        "Every vehicle that is not hidden is detected in every scan, and there are no false detections.",
        _table(ideal),
    ]
    return markdown_page(parts)


def _table(rows: Sequence[dict[str, Any]]) -> list[str]:
    measures = ablated_quantities()
    heading = ["tracker", "what is different", *(measure.label for measure in measures)]
    cells = [[f"`{row['variant']}`", row["what"], *(_cell(row, measure) for measure in measures)] for row in rows]
    return markdown_table(heading, cells)


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
    seeds = np.arange(len(differences))
    low, high = paired_effect(np.zeros(len(seeds)), differences, np.zeros_like(seeds), seeds).ci95
    return round(low, 4), round(high, 4)


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
