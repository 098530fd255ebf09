"""What it costs trackers that the world is not as they believe: a ready grid of mismatches, and its table.

The true sensor is changed by settings of ``sensor.*``, of which the data sheet says nothing; what is believed is
changed by ``tracker.believes.*``. Within a mismatch all trackers are given the same detections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harness.grid.cells import DEMAND, DENSITY, MISMATCH, NET, RECORDING, SEED
from harness.grid.rows import column_of
from harness.scoring.statistics import few_groups_ci
from harness.sensor.settings import SensorSettings
from mmpf.compute.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd

AS_IS = "as is"
HOTA, SWITCHES, COVERAGE = "mot.hota", "mot.id_switches", "calibration.coverage95.lon"


def mismatches(sensor: SensorSettings) -> dict[str, tuple[str, ...]]:
    """Return the settings of each mismatch by its name; those that multiply, on top of the sensor's figures."""
    return {
        AS_IS: (),
        "noise believed x 0.5": ("tracker.believes.noise_factor=0.5",),
        "noise believed x 2": ("tracker.believes.noise_factor=2.0",),
        "detection probability 0.7": ("sensor.detection_probability=0.7",),
        "clutter x 5": (
            f"sensor.clutter_per_scan={5.0 * max(sensor.clutter_per_scan, 0.1):g}",
            f"sensor.persistent_clutter={5.0 * sensor.persistent_clutter:g}",
        ),
        "noise correlated": ("sensor.bias_share=0.9", "sensor.bias_time_s=1.0"),
        "bursts 15 % of 0.8 s": ("sensor.burst_share=0.15", "sensor.burst_s=0.8"),
    }


@dataclass(frozen=True)
class Cost:
    """What a mismatch costs a tracker, means over the runs of the grid.

    Attributes:
        variant: The tracker as the user wrote it.
        model: Its motion model; empty if it takes none.
        mismatch: The mismatch.
        hota: HOTA in sight, percent.
        hota_loss: HOTA without the mismatch less that, run by run, points; nan without such runs.
        hota_loss_ci95: Its 95 % interval over the runs, Student's.
        id_switches: Identity switches a run.
        coverage95_lon: Percent of true longitudinal positions in the 95 % intervals.
        runs: Number of runs that ended well.
    """

    variant: str
    model: str
    mismatch: str
    hota: float
    hota_loss: float
    hota_loss_ci95: tuple[float, float]
    id_switches: float
    coverage95_lon: float
    runs: int


def costs(table: pd.DataFrame) -> list[Cost]:
    """Return what each mismatch costs each tracker, from the rows of the grid."""
    table = table[table["succeeded"].astype(bool)].copy()
    table["model"] = table["model"].fillna("")
    world = [name for name in (NET, DENSITY, DEMAND, RECORDING, SEED) if name in table]
    axes = [name for name in map(str, table) if name.startswith(("sensor.", "tracker.", "traffic."))]
    # As text, since missing values are no keys to join on.
    table["world"] = ["|".join(map(str, row)) for row in table[[*world, *axes]].itertuples(index=False)]
    found = []
    for (variant, model), rows in table.groupby(["variant", "model"], sort=False):
        usual = rows[rows[MISMATCH] == AS_IS].set_index("world")[HOTA]
        for mismatch, some in rows.groupby(MISMATCH, sort=False):
            loss = usual.reindex(some["world"]).to_numpy(dtype=np.float64) - column_of(some, HOTA)
            loss = loss[np.isfinite(loss)]
            found.append(
                Cost(
                    variant=str(variant),
                    model=str(model),
                    mismatch=str(mismatch),
                    hota=_mean(column_of(some, HOTA)),
                    hota_loss=_mean(loss),
                    hota_loss_ci95=_interval(loss),
                    id_switches=_mean(column_of(some, SWITCHES)),
                    coverage95_lon=_mean(column_of(some, COVERAGE)),
                    runs=len(some),
                )
            )
    return found


def costs_markdown(found: Sequence[Cost], failures: Sequence[str]) -> str:
    """Return the table, a line for each tracker and mismatch, and which runs failed."""
    lines = [
        "# What mismatches cost",
        "",
        "Trackers believe the sensor's data sheet; a mismatch changes what is true, or the noise that they are told.",
        "Loss is HOTA under *as is* less HOTA under the mismatch, paired run by run, with its 95 % interval.",
        "",
        "| tracker | mismatch | HOTA | loss | identity switches | 95 % intervals cover | runs |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for cost in found:
        loss = "" if cost.mismatch == AS_IS else _with_interval(cost.hota_loss, cost.hota_loss_ci95)
        name = " ".join(word for word in (cost.variant, cost.model) if word)
        lines.append(
            f"| {name} | {cost.mismatch} | {cost.hota:.1f} | {loss} | {cost.id_switches:.1f} | "
            f"{_percent(cost.coverage95_lon)} | {cost.runs} |"
        )
    if failures:
        lines += ["", "Failed:", "", *(f"- {line}" for line in failures)]
    return "\n".join(lines) + "\n"


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _interval(values: FloatArray) -> tuple[float, float]:
    if len(values) < 2:
        return float("nan"), float("nan")
    interval = few_groups_ci(values, np.ones(len(values)))
    return interval.low, interval.high


def _with_interval(loss: float, ends: tuple[float, float]) -> str:
    if not np.isfinite(loss):
        return "-"
    return f"{loss:.1f} [{ends[0]:.1f}, {ends[1]:.1f}]" if np.isfinite(ends[0]) else f"{loss:.1f}"


def _percent(share: float) -> str:
    return f"{share:.0f} %" if np.isfinite(share) else "-"
