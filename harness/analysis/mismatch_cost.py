"""What each mismatch between world and tracker costs, over the worlds of ``harness.grid.worlds``."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, field

import numpy as np
import pandas as pd

from harness.analysis.leading import common_runs, lead
from harness.analysis.verdicts import FEWEST_TOLD
from harness.common.effects import Effect
from harness.common.intervals import Possible, possible_ci
from harness.common.markdown import PagePart, markdown_page, markdown_table
from harness.common.numbers import number
from harness.config.model import TrafficConfig
from harness.scoring.metrics.in_plain_view import STANDING_MPS, STANDING_S
from harness.storage.schema import AS_IS, DEMAND, DENSITY, MISMATCH, NET, RECORDING, SEED
from mmpf.options.base import fields_of

NAN = float("nan")
TRAFFIC_SETTINGS = {f"traffic.{key}" for key, _ in fields_of(TrafficConfig)}
HOTA = "mot.hota"
SCORES = {
    "hota": HOTA,
    "id_switches": "mot.id_switches",
    "coverage95_lon": "calibration.coverage95.lon",
    "recall": "in_plain_view.recall",
    "worst_tenth": "in_plain_view.worst_tenth",
    "stopped": "in_plain_view.stopped_recall",
    "missed": "mot.missed",
    "hidden_cost_m": "hidden.hidden_cost_m",
    "false_tracks_per_scan": "mot.false_tracks_per_scan",
}
"""Of each mean of a ``Cost`` the column of the grid."""
RUN = ["setting", "unit", SEED]
STOPPED = "stopped amid traffic"
"""Column of the recall of stopped vehicles, which a table without any leaves out."""
STOPPED_NOTE = f"Stopped amid traffic: slower than {STANDING_MPS:g} m/s for {STANDING_S:g} s while others drive."
LEADS = {"HOTA": HOTA, "worst tenth": SCORES["worst_tenth"], STOPPED: SCORES["stopped"]}
"""The scores by which the first tracker is held against the others, all in points."""


@dataclass(frozen=True)
class Cost:
    """What a mismatch costs a tracker with a motion model, means over the runs of the grid.

    Attributes:
        variant: The tracker as the user wrote it.
        hota_loss: HOTA without the mismatch less that, run by run, points; nan without such runs.
        coverage95_lon: Percent of true longitudinal positions in the 95 % intervals.
        runs: Number of runs that ended well.
        recall: Percent of vehicle-steps in plain view that have a reported track; nan of runs without that score.
        worst_tenth: The same of the worst tenth of vehicles.
        stopped: The same of vehicles that stand while others drive; nan without any.
        missed: Missed vehicle-steps in sight a run.
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
    hota_ci95: tuple[float, float] = field(default=(NAN, NAN))
    recall: float = NAN
    worst_tenth: float = NAN
    stopped: float = NAN
    missed: float = NAN
    hidden_cost_m: float = NAN
    false_tracks_per_scan: float = NAN

    @property
    def name(self) -> str:
        """The tracker's label with its model."""
        return " ".join(word for word in (self.variant, self.model) if word)


@dataclass(frozen=True)
class Lead:
    """How far the first tracker is ahead of the best of the others by a score's mean, in a world.

    Paired run by run, with the 95 % interval over seeds; runs are those that both ended well.
    """

    mismatch: str
    score: str
    first: str
    best_other: str
    ahead: float
    ahead_ci95: tuple[float, float]
    runs: int


def costs(table: pd.DataFrame) -> list[Cost]:
    """Return what each mismatch costs each tracker, from the rows of the grid."""
    found = []
    for (variant, model), rows in _by_world(table).groupby(["variant", "model"], sort=False):
        usual = rows[rows[MISMATCH] == AS_IS].set_index(RUN)[HOTA]
        for mismatch, some in rows.groupby(MISMATCH, sort=False):
            here = some.set_index(RUN).reindex(columns=[*SCORES.values()]).astype(float)
            loss = lead(pd.DataFrame({"usual": usual.reindex(here.index), "here": here[HOTA]}).dropna())
            hota = here[HOTA].dropna().groupby("unit").agg(["sum", "count"]).to_numpy(dtype=np.float64)
            interval = possible_ci(hota[:, 0], hota[:, 1], Possible(most=100.0))
            found.append(
                Cost(
                    variant=str(variant),
                    model=str(model),
                    mismatch=str(mismatch),
                    hota_loss=loss.difference,
                    hota_loss_ci95=_interval(loss),
                    runs=len(some),
                    hota_ci95=(interval.low, interval.high),
                    **dict(zip(SCORES, here.mean(), strict=True)),
                )
            )
    return found


def leads(table: pd.DataFrame) -> list[Lead]:
    """Return how far the first tracker is ahead of the best of the others by each of ``LEADS``, world by world.

    A world in which it has no score, or each of the others lacks it at a setting, has none.
    """
    rows, found = _by_world(table), []
    first = rows["name"].iloc[0] if len(rows) else ""
    for score, column in LEADS.items():
        for mismatch, some in rows.groupby(MISMATCH, sort=False):
            values = some.reindex(columns=[*RUN, "name", column]).pivot_table(column, RUN, "name")
            others = common_runs(values.dropna(subset=first)).drop(columns=first) if first in values else values[:0]
            if not others.empty:
                best = str(others.mean().idxmax())
                pairs = values[[first, best]].dropna()
                ahead = lead(pairs)
                found.append(Lead(str(mismatch), score, first, best, ahead.difference, _interval(ahead), len(pairs)))
    return found


def _by_world(table: pd.DataFrame) -> pd.DataFrame:
    """Return the runs that ended well, each with the traffic and settings that it shares with those of others."""
    table = table[table["succeeded"].astype(bool)].copy()
    table["model"] = table["model"].fillna("")
    table["name"] = (table["variant"] + " " + table["model"]).str.strip()
    traffic = [name for name in (NET, DENSITY, DEMAND) if name in table]
    # Scores of the traffic begin with the name of its settings.
    axes = [name for name in map(str, table) if name.startswith(("sensor.", "tracker.")) or name in TRAFFIC_SETTINGS]
    # As text, since missing values are no keys to join on.
    table["setting"] = ["|".join(map(str, row)) for row in table[[*traffic, *axes]].itertuples(index=False)]
    table["unit"] = table[RECORDING if RECORDING in table else SEED].astype(str)
    return table


COLUMNS: dict[str, Callable[[Cost], str]] = {
    "tracker": lambda cost: cost.name,
    "mismatch": lambda cost: cost.mismatch,
    "HOTA": lambda cost: _points(cost.hota, cost.hota_ci95),
    "loss": lambda cost: "" if cost.mismatch == AS_IS else _points(cost.hota_loss, cost.hota_loss_ci95),
    "identity switches": lambda cost: number(cost.id_switches, 1),
    "recall in plain view": lambda cost: number(cost.recall, 1, " %"),
    "worst tenth": lambda cost: number(cost.worst_tenth, 1, " %"),
    STOPPED: lambda cost: number(cost.stopped, 1, " %"),
    "missed": lambda cost: number(cost.missed, 0),
    "hidden cost, m": lambda cost: number(cost.hidden_cost_m, 2),
    "false tracks a scan": lambda cost: number(cost.false_tracks_per_scan, 2),
    "95 % intervals cover": lambda cost: number(cost.coverage95_lon, 0, " %"),
    "runs": lambda cost: str(cost.runs),
}
"""The table of costs: headings, and what stands below them."""


def costs_markdown(found: Sequence[Cost], failures: Sequence[str], ahead: Sequence[Lead] = ()) -> str:
    """Return the table, a line for each tracker and mismatch, who is ahead by how much, and which runs failed."""
    told = {
        head: cell for head, cell in COLUMNS.items() if head != STOPPED or np.isfinite([c.stopped for c in found]).any()
    }
    parts: list[PagePart] = [
        "# What mismatches cost",
        "Trackers assume the sensor's data sheet; a mismatch changes the true sensor, or the noise or map that "
        "trackers receive.\n"
        "Loss is HOTA under *as is* less HOTA under the mismatch, paired run by run, with its 95 % interval.\n"
        "Missed: vehicle-steps in sight without a track, per run; `5-hz` has half as many steps.",
        markdown_table([*told], [[cell(cost) for cell in told.values()] for cost in found]),
        *([STOPPED_NOTE] if STOPPED in told else []),
    ]
    if ahead:
        heads = ("mismatch", "score", "first", "best of the others", "ahead of it, points", "runs")
        rows = [(*astuple(lead)[:4], _points(lead.ahead, lead.ahead_ci95), str(lead.runs)) for lead in ahead]
        parts += ["The first tracker against the best of the others by each score, paired run by run:"]
        parts += [markdown_table(heads, rows)]
    if failures:
        parts += ["Failed:", [f"- {line}" for line in failures]]
    return markdown_page(parts)


def _interval(effect: Effect) -> tuple[float, float]:
    """Return the interval of a difference of percentages; nan where few units tell of more than 100 points."""
    impossible = effect.units < FEWEST_TOLD and max(map(abs, effect.ci95)) > 100.0
    return (NAN, NAN) if effect.se <= 0.0 or impossible else effect.ci95


def _points(value: float, ends: tuple[float, float]) -> str:
    told = number(value, 1)
    return f"{told} [{ends[0]:.1f}, {ends[1]:.1f}]" if np.isfinite(ends[0]) else told
