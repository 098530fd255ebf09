"""The chart of a comparison: each metric's difference with its interval on one scale; better is to the right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from harness.analysis.compare import Judgement
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE, Rules, Verdict, name_of, quantity_of
from harness.common.charts import HIT_AREA, Chart, Charts, Spec, colour_by, spec_of, strength, tooltip_of

COLOURS = (
    (WORSE, "var(--hidden)"),
    (UNDECIDED, "var(--partial)"),
    (NO_WORSE, "var(--visible)"),
    (BETTER, "var(--series-0)"),
    (UNTESTED, "var(--edge)"),
)
IN_WORDS = {UNTESTED: "described, not tested"}
LINEAR_PERCENT = 3.0
"""Up to this the scale is even; beyond, equal ratios take equal lengths."""
TICKS = [-1000, -300, -100, -30, -10, -3, -1, 0, 1, 3, 10, 30, 100, 300, 1000]
LEAST_SHOWN, MOST_SHOWN = 5.0, 2000.0
ZERO_PLAIN = "datum.value == 0 ? '0' : format(datum.value, '+,d')"
ROW_PX, FRAME_PX = 36, 60
NOTE = (
    "How much better (right) or worse (left) b is than a, in percent of a's value, with 95 % intervals. The grey band "
    "is the tolerance: b is no worse if its whole interval lies to the right of the band's left edge. Beyond {:g} %, "
    "the scale is logarithmic. A dot without a line has no interval."
)
NOT_DRAWN = " Not shown, because a is 0: {}."
HINT = "Point at a value to read it in its own unit."


def comparison_charts(comparison: Judgement) -> Charts | None:
    """Return a chart for each tracker that was compared; None where no metric has a difference."""
    charts = []
    for label in dict.fromkeys(verdict.label for verdict in comparison.verdicts):
        of_label = [verdict for verdict in comparison.verdicts if verdict.label == label]
        rows = [row for verdict in of_label if (row := _row(verdict, comparison.rules))]
        if rows:
            description = f"{label}: difference of b from a in each metric, with 95 % intervals"
            spec = spec_of(description, rows, _layers(rows), ROW_PX * len(rows) + FRAME_PX)
            charts.append(Chart(label, description, spec))
    shown = {row["verdict"] for chart in charts for row in chart.spec["data"]["values"]}
    lines = tuple((IN_WORDS.get(word, word), colour) for word, colour in COLOURS if IN_WORDS.get(word, word) in shown)
    of_zero = dict.fromkeys(name_of(each.metric) for each in comparison.verdicts if each.a == 0.0 and each.difference)
    note = NOTE.format(LINEAR_PERCENT) + (NOT_DRAWN.format(", ".join(of_zero)) if of_zero else "")
    return Charts(tuple(charts), lines, note, HINT, wide=True) if charts else None


def _row(verdict: Verdict, rules: Rules) -> dict[str, Any] | None:
    """Return a metric's difference in percent of a, better positive; None where that has no meaning."""
    quantity = quantity_of(verdict.metric)
    if not verdict.a or not math.isfinite(verdict.difference):
        return None
    scale = (100.0 if quantity.higher_is_better else -100.0) / abs(verdict.a)
    ends = sorted(scale * end for end in verdict.ci95) if math.isfinite(verdict.ci95[0]) else None
    low, high = (max(-MOST_SHOWN, min(MOST_SHOWN, end)) for end in ends) if ends else (None, None)
    judged = rules.judges(quantity) and math.isfinite(verdict.margin)
    band = 100.0 * verdict.margin / abs(verdict.a) if judged else None
    decimals = quantity.decimals + 1
    interval = f"{verdict.ci95[0]:+.{decimals}f} to {verdict.ci95[1]:+.{decimals}f}" if ends else "-"
    return {
        "metric": quantity.label, "change": max(-MOST_SHOWN, min(MOST_SHOWN, scale * verdict.difference)),
        "low": low, "high": high, "tolerance": band, "below": None if band is None else -band,
        "verdict": IN_WORDS.get(verdict.verdict, verdict.verdict),
        "values": f"{verdict.a:.{decimals}f} and {verdict.b:.{decimals}f}",
        "difference": f"{verdict.difference:+.{decimals}f}", "interval": interval, "pairs": str(verdict.pairs),
    }  # fmt: skip


def _layers(rows: Sequence[dict[str, Any]]) -> list[Spec]:
    shown = (row[name] for row in rows for name in ("change", "low", "high"))
    reach = 1.15 * max(LEAST_SHOWN, *(abs(value) for value in shown if value is not None))
    lines = [(IN_WORDS.get(word, word), colour) for word, colour in COLOURS]
    x: Spec = {
        "type": "quantitative",
        "title": "b worse  ←  change in % of a  →  b better",
        "scale": {"type": "symlog", "constant": LINEAR_PERCENT, "domain": [-reach, reach], "nice": False},
        "axis": {
            "values": [tick for tick in TICKS if abs(tick) <= reach],
            "labelExpr": ZERO_PLAIN,
            "labelOverlap": True,
        },
    }
    # Names stand above their rows, so that the plot keeps its width on a small screen.
    axis: Spec = {
        "title": None, "labelLimit": 0, "grid": False, "ticks": False, "domain": False, "labelAlign": "left",
        "labelPadding": -4, "labelOffset": -11,
    }  # fmt: skip
    y: Spec = {"field": "metric", "type": "nominal", "sort": None, "axis": axis}
    shade: Spec = {"color": colour_by("verdict", lines), "opacity": strength("verdict")}
    tooltip = tooltip_of(
        ("metric", "metric"), ("values", "a and b"), ("difference", "b minus a"), ("interval", "95 % interval"),
        ("pairs", "pairs"), ("verdict", "b is"),
    )  # fmt: skip
    return [
        {
            "mark": {"type": "bar", "height": {"band": 0.4}, "color": "var(--line)", "tooltip": None},
            "encoding": {"y": y, "x": {**x, "field": "below"}, "x2": {"field": "tolerance"}},
        },
        {"data": {"values": [{}]}, "mark": {"type": "rule"}, "encoding": {"x": {**x, "datum": 0}}},
        {
            "mark": {"type": "rule", "strokeWidth": 2},
            "encoding": {"y": y, "x": {**x, "field": "low"}, "x2": {"field": "high"}} | shade,
        },
        {
            "mark": {"type": "point", "filled": True, "size": 70},
            "encoding": {"y": y, "x": {**x, "field": "change"}} | shade,
        },
        {
            "mark": {"type": "point", "filled": True, "size": HIT_AREA, "opacity": 0},
            "encoding": {"y": y, "x": {**x, "field": "change"}, "tooltip": tooltip},
        },
    ]
