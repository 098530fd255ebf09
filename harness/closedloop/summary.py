"""Scores of each belief, and their differences from driving by the truth, episode by episode."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.closedloop.beliefs import TRUTH
from harness.closedloop.plan import CROSS, DARK, FREE, KIND, PROVOKED, STOPPED
from harness.common.charts import Charts, curves, lines_of
from harness.common.effects import in_proportion, paired_effect
from harness.common.intervals import possible_ci
from harness.common.markdown import markdown_table
from harness.scoring.metrics.closedloop import COLLIDED, ENDED, HARD_BRAKES, IMPACT, NO_CANDIDATE, QUANTITIES, TTC
from harness.scoring.metrics.quantity import Quantity
from harness.storage.grid_folder import column_of
from mmpf.numerics.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd

ALL, PROVOKED_ONES, FREE_ONES = "all", "provoked", "free"
SEEN_BEFORE, NEVER_SEEN = "cross, seen before", "cross, never seen"
CHARTED = (COLLIDED, TTC, HARD_BRAKES)
ALSO_TOLD = {TTC: "time to collision below 1.5 s for {:.2f} % of the time", HARD_BRAKES: "{:.1f} hard brakes a km"}
UNPAIRED = (IMPACT,)
"""What only some episodes have, other ones with each belief, so that no pairs are left."""
WORST_LISTED = 60
WIDEST = 10.0
"""An interval that reaches beyond so many times the mean tells nothing: there are too few seeds for one."""


@dataclass(frozen=True)
class Score:
    """A belief's mean of one quantity.

    Attributes:
        episodes: ``all``, ``free``, ``provoked``, or a kind of provocation where there are several.
        n: Episodes with a value; without any ``mean`` is None.
        ci95: Interval over seeds, of values that it can have; None with fewer than two, or beyond ``WIDEST``.
        excess: Mean difference from the truth in the same episodes; None where there is no pair.
        excess_ci95: Student's interval of that over seeds; None with fewer than two, or where none differs.
    """

    belief: str
    episodes: str
    metric: str
    n: int
    mean: float | None
    ci95: tuple[float, float] | None
    excess: float | None
    excess_ci95: tuple[float, float] | None


def scores(table: pd.DataFrame) -> list[Score]:
    """Score every belief and kind of episode in the rows of ``runs.parquet``."""
    done = table[table["succeeded"].astype(bool)]
    if not len(done):
        return []
    done = done[done[ENDED] != NO_CANDIDATE]
    found = []
    for name, episodes in _groups(done):
        truth = episodes[episodes["variant"] == TRUTH]
        for belief in dict.fromkeys(episodes["variant"]):
            rows = episodes[episodes["variant"] == belief]
            told = [each for each in QUANTITIES if np.isfinite(column_of(episodes, each.key)).any()]
            found += [_score(belief, name, quantity, rows, truth) for quantity in told]
    return found


def as_markdown(title: str, found: Sequence[Score], table: pd.DataFrame, failures: Sequence[str]) -> str:
    """Return the tables: means with intervals, what is in excess of the truth's, and the collisions."""
    explanation = [EXPLANATION, *(text for kind, text in EXPLANATIONS.items() if kind in set(table[KIND]))]
    lines = [f"# {title}", "", *_answers(found), "", QUESTION, "", *_about(table), ""]
    for name in dict.fromkeys(score.episodes for score in found):
        part = [score for score in found if score.episodes == name]
        lines += [f"## {_heading(name, part)}", "", *_table(part), ""]
    lines += [*_collisions(table), "## What is counted", "", " ".join(explanation), ""]
    if failures:
        lines += ["## Failed drives", "", *(f"- {failure}" for failure in failures), ""]
    return "\n".join(lines)


QUESTION = (
    "The ego's driver perceives the true vehicles (`truth`), the detections alone, or the tracks of one tracker. All "
    "drive the same episodes. *Minus truth* is the mean difference from driving with the truth in the same episodes."
)
EXPLANATION = (
    "Means over episodes, with 95 % intervals over seeds where there are enough seeds; a seed has two episodes. All is "
    "measured in the true traffic until the episode ends: after 20 s, at a collision, or at the end of the road. "
    "*Missed* braking: for half a second or longer, the driver would choose -2 m/s² or less with the truth, and "
    "chooses more than -1 m/s² with its perception. *Phantom* braking: the reverse. For a vehicle right ahead in plain "
    "view without a track, a braking is also missed if, for half a second within one second, the driver brakes at "
    "least 1 m/s² less than with the truth, or does not brake at a time to collision below 4 s. Impact speed is the "
    "mean over collisions."
)
OF_CROSSINGS = (
    "In episodes *cross* the ego comes up to a crossing where it must let a hidden car, the provoked vehicle, pass. It "
    "has let it pass also if it waits until the end. *Waiting* is driving slower than 1 m/s before the crossing. The "
    "post-encroachment time is that with the vehicles that have right of way, and 0 after a collision with one; such a "
    "vehicle brakes hard if it brakes by more than 3 m/s² while the ego crosses."
)
OF_STOPPED = (
    "In episodes *stopped* a vehicle stands in the ego's lane while the traffic flows; nobody is between them, and at "
    "the hand-over it is just out of the sensor's range."
)
OF_DARK = "In episodes *dark* the leader, in plain view but detected in a share of the scans only, brakes by 5 m/s²."
EXPLANATIONS = {CROSS: OF_CROSSINGS, STOPPED: OF_STOPPED, DARK: OF_DARK}


def _groups(done: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    yield ALL, done
    free = done[KIND] == FREE
    if free.any() and not free.all():
        yield FREE_ONES, done[free]
        yield PROVOKED_ONES, done[~free]
    provoked = [kind for kind in PROVOKED if (done[KIND] == kind).any()]
    for kind in provoked if len(provoked) > 1 else ():
        yield kind, done[done[KIND] == kind]
    seen = column_of(done, "episode.seen_before")
    if (seen == 0.0).any() and (seen == 1.0).any():
        yield SEEN_BEFORE, done[seen == 1.0]
        yield NEVER_SEEN, done[seen == 0.0]


def _score(belief: str, episodes: str, quantity: Quantity, rows: pd.DataFrame, truth: pd.DataFrame) -> Score:
    known = rows[np.isfinite(column_of(rows, quantity.key))]
    values, weight = column_of(known, quantity.key), _weight(known, quantity)
    mean = float(np.average(values, weights=weight)) if len(known) else None
    excess, interval = _excess(rows, truth, quantity)
    own = _ci(values, weight, known["seed"].to_numpy(dtype=np.int64), quantity)
    return Score(belief, episodes, quantity.key, len(known), mean, own, excess, interval)


def _weight(rows: pd.DataFrame, quantity: Quantity, suffix: str = "") -> FloatArray:
    """Return what each episode counts: for events a kilometre how far it drove."""
    return column_of(rows, quantity.weight + suffix) if quantity.weight else np.ones(len(rows))


def _ci(
    values: FloatArray, weight: FloatArray, seeds: np.ndarray[tuple[int], np.dtype[np.int64]], quantity: Quantity
) -> tuple[float, float] | None:
    place = np.unique(seeds, return_inverse=True)[1]
    sums, counts = (np.bincount(place, weights=each).astype(np.float64) for each in (weight * values, weight))
    interval = possible_ci(sums, counts, quantity.possible)
    told = np.isfinite(interval.low) and (not sums.any() or interval.high <= WIDEST * sums.sum() / counts.sum())
    return (interval.low, interval.high) if told else None


def _excess(
    rows: pd.DataFrame, truth: pd.DataFrame, quantity: Quantity
) -> tuple[float | None, tuple[float, float] | None]:
    """Return the mean difference from the truth and its interval, seeds being independent and kinds apart."""
    if quantity.key in UNPAIRED or not len(truth):
        return None, None
    keys = ["seed", KIND]
    columns = list(dict.fromkeys([*keys, quantity.key, quantity.weight or quantity.key]))
    if quantity.key not in rows:
        return None, None
    pairs = truth[columns].merge(rows[columns], on=keys, suffixes=(None, "_b")).dropna()
    if not len(pairs):
        return None, None
    a, b = (
        in_proportion(column_of(pairs, quantity.key + suffix), _weight(pairs, quantity, suffix))
        for suffix in ("", "_b")
    )
    stratum = np.unique(pairs[KIND].astype(str), return_inverse=True)[1].astype(np.int64)
    effect = paired_effect(a, b, stratum, pairs["seed"].to_numpy(dtype=np.int64))
    # What never differed may differ yet, and no difference leads out of what can be.
    if not effect.se > 0.0:
        return effect.difference, None
    possible, truth_mean = quantity.possible, float(a.mean())
    low, high = np.clip(effect.ci95, possible.least - truth_mean, possible.most - truth_mean)
    return effect.difference, (float(low), float(high))


def _about(table: pd.DataFrame) -> list[str]:
    """Return how many episodes there are, and what was looked through to find them."""
    done = table[table["succeeded"].astype(bool)].drop_duplicates(["seed", KIND])
    lines = []
    for kind, episodes in done.groupby(KIND, sort=False):
        none = int((episodes[ENDED] == NO_CANDIDATE).sum())
        looked = column_of(episodes, "episode.looked_through")
        line = f"{len(episodes) - none} *{kind}*"
        if kind != FREE:
            line += f" (cars examined as ego: {int(np.nansum(looked))})"
            line += f"; {none} more have no candidate" if none else ""
        lines.append(line)
    return [f"Episodes: {'; '.join(lines)}."]


def _heading(name: str, part: Sequence[Score]) -> str:
    episodes = max((score.n for score in part), default=0)
    return f"{name.capitalize()} episodes, {episodes}"


def _answers(found: Sequence[Score]) -> list[str]:
    """Return a line for each belief: its number of collisions, close approaches and hard brakes."""
    lines = []
    for belief in dict.fromkeys(score.belief for score in found):
        own = {score.metric: score for score in found if (score.belief, score.episodes) == (belief, ALL)}
        collided = own.get(COLLIDED)
        if collided is None or collided.mean is None:
            continue
        hit = round(0.01 * collided.mean * collided.n)
        line = f"- **{belief}**: {hit} of {collided.n} episodes end in a collision"
        for key, words in ALSO_TOLD.items():
            if key in own and own[key].mean is not None:
                line += f"; {words.format(own[key].mean)}"
        lines.append(f"{line}.")
    return lines


def _table(part: Sequence[Score]) -> list[str]:
    """Return a table with a row for each quantity: each belief's mean, then how far it is from the truth's."""
    of = {(score.metric, score.belief): score for score in part}
    beliefs = list(dict.fromkeys(score.belief for score in part))
    others = [belief for belief in beliefs if belief != TRUTH]
    rows = []
    for quantity in QUANTITIES:
        own = {belief: of[quantity.key, belief] for belief in beliefs if (quantity.key, belief) in of}
        if not own:
            continue
        means = [_cell(own[belief].mean, own[belief].ci95, quantity.decimals, "") for belief in beliefs]
        excesses = [_cell(own[belief].excess, own[belief].excess_ci95, quantity.decimals, "+") for belief in others]
        rows.append([quantity.label, *means, *excesses])
    headings = [*beliefs, *(f"{belief} minus truth" for belief in others)]
    return markdown_table(["in the true traffic", *headings], rows)


def _cell(value: float | None, ci95: tuple[float, float] | None, decimals: int, sign: str) -> str:
    if value is None:
        return "-"
    text = f"{value:{sign}.{decimals}f}"
    return text if ci95 is None else f"{text} [{ci95[0]:{sign}.{decimals}f}, {ci95[1]:{sign}.{decimals}f}]"


def _collisions(table: pd.DataFrame) -> list[str]:
    """Return the list of collisions, the hardest first, each with what it leads to."""
    collided = table[column_of(table, COLLIDED) > 0.0]
    if not len(collided):
        return []
    collided = collided.sort_values([IMPACT, "seed", "variant"], ascending=[False, True, True], kind="stable")
    headings = ("impact m/s", "driven by", "seed", "episode", "after s", "with", "replay")
    rows = [
        [
            f"{row[IMPACT]:.1f}", row["variant"], str(row["seed"]), row[KIND],
            f"{row['drive.collision_time_s']:.1f}", row["drive.collided_with"],
            f"[look]({row['replay']})" if row.get("replay") else "-",
        ]
        for _, row in collided.head(WORST_LISTED).iterrows()
    ]  # fmt: skip
    more = f" (the {WORST_LISTED} hardest of {len(collided)})" if len(collided) > WORST_LISTED else ""
    return [f"## Episodes that ended in a collision{more}", "", *markdown_table(headings, rows), ""]


def as_values(found: Sequence[Score]) -> list[dict[str, Any]]:
    """Return scores as plain values."""
    return [asdict(score) for score in found]


def drive_charts(found: Sequence[Score]) -> Charts:
    """Return means with 95 % intervals of collisions, short times to collision and hard brakes, by belief."""
    kinds = dict.fromkeys(score.episodes for score in found)
    counts = {kind: max(score.n for score in found if score.episodes == kind) for kind in kinds}
    series = {kind: f"{kind} episodes, {count}" for kind, count in counts.items()}
    lines, charts = lines_of(list(series.values())), []
    for metric in CHARTED:
        title = next(quantity.label for quantity in QUANTITIES if quantity.key == metric)
        rows = []
        for score in found:
            if score.metric == metric and score.mean is not None:
                low, high = score.ci95 or (None, None)
                row = {"series": series[score.episodes], "place": score.belief, "mean": score.mean}
                rows.append({**row, "low": None if low is None else max(low, 0.0), "high": high})
        if rows:
            tooltip = (("place", "driven by"), ("series", "episodes"), ("mean", title))
            charts.append(curves(title, f"{title}, by belief", "driven by", rows, lines, tooltip))
    note = "Means with 95 % intervals over seeds. Where all episodes have 0, the bar shows what so few do not rule out."
    return Charts(tuple(charts), lines, note)
