"""The pooled scores as Markdown tables, and the chart of hidden errors."""

from collections.abc import Sequence
from dataclasses import astuple

from harness.analysis.coasting_ratio import COASTING_TRACKER, ON_PURPOSE, ON_PURPOSE_SCORES, on_purpose
from harness.analysis.pooled import HiddenError, Pooled, pooled_name, pooled_quantities
from harness.analysis.tables import value_cell
from harness.common.charts import Charts, curves, lines_of
from harness.common.markdown import PagePart, markdown_page, markdown_table

TITLE = "Recorded traffic"
WINDOWS_NOTE = (
    "A window is the time for which one vehicle is hidden; situations are of windows of all lengths. The ratio is the "
    "sum of errors over the sum of constant velocity's (the true state at the last detection, extrapolated), at the "
    "ends of the windows after which the tracker follows the vehicle; the ellipse's share is of these windows too. The "
    "cost is the mean error over all windows, 10 m at most and where no track follows."
)


def pooled_markdown(pooled: Pooled, failures: Sequence[str]) -> str:
    """Return all tables and what failed."""
    parts: list[PagePart] = [
        f"# {TITLE}",
        "Every vehicle that carries the sensor is a separate episode; all trackers got the same detections. Means "
        "over all samples of all files, with Student's 95 % intervals over files.",
        _score_table(pooled),
        *_on_purpose(pooled),
        "## Hidden vehicles by the time since their last detection",
        "Mean absolute longitudinal error, m; in brackets that of constant-velocity prediction with the true "
        "association, on the same vehicle-steps; then the ratio with its interval, the number of vehicle-steps and the "
        "share of all hidden ones that the tracker follows.",
        _hidden_table(pooled),
        "![hidden](figures/hidden.png)",
        *(["## Files", _file_table(pooled)] if pooled.files else []),
    ]
    if failures:
        parts += ["## Runs that failed", [f"- {failure}" for failure in failures]]
    return markdown_page(parts)


def _score_table(pooled: Pooled) -> list[str]:
    found = {(mean.tracker, mean.quantity): mean for mean in pooled.means}
    columns = [column for column in pooled_quantities() if any(key == pooled_name(column) for _, key in found)]
    rows = [
        [label, str(switches), *(value_cell(found[label, pooled_name(column)], column.decimals) for column in columns)]
        for label, switches in pooled.id_switches.items()
    ]
    return markdown_table(["tracker", "identity switches", *(column.label for column in columns)], rows)


def _on_purpose(pooled: Pooled) -> list[PagePart]:
    """Return the table of vehicles hidden on purpose with what its columns mean; nothing where none is hidden."""
    found = {(mean.tracker, mean.quantity): mean for mean in pooled.means}
    kinds = dict.fromkeys(key.split(".", 1)[1].rpartition(".")[0] for _, key in found if key.startswith(ON_PURPOSE))
    rows = []
    for kind in kinds:
        for label in pooled.id_switches:
            scores = [(found[label, each.key], each.decimals) for each in on_purpose([kind])]
            cells = [value_cell(mean, decimals) for mean, decimals in scores]
            rows.append([kind.replace("_", " "), label, str(scores[0][0].n), *cells])
    heads = ["hidden for, or while", "tracker", "windows", *(score.label for score in ON_PURPOSE_SCORES)]
    return ["## Vehicles hidden on purpose", WINDOWS_NOTE, markdown_table(heads, rows)] if rows else []


def _hidden_table(pooled: Pooled) -> list[str]:
    heads = list(dict.fromkeys(_time(error) for error in pooled.hidden))
    found = {(error.tracker, _time(error)): error for error in pooled.hidden}
    rows = [[label, *(_hidden_cell(found[label, head]) for head in heads)] for label in pooled.id_switches]
    return markdown_table(["tracker", *heads], rows)


def _file_table(pooled: Pooled) -> list[str]:
    rows = [list(map(str, astuple(count))) for count in pooled.files]
    total = ["all", *(str(sum(int(row[place]) for row in rows)) for place in range(1, 6))]
    heads = ["file", "vehicles read", "driven", "left out", "carried the sensor", "runs"]
    return markdown_table(heads, [*rows, total])


def _time(error: HiddenError) -> str:
    return "all" if error.to_s is None else f"{error.from_s:g} to {error.to_s:g} s"


def _hidden_cell(error: HiddenError) -> str:
    if error.lon_m is None or error.ratio is None:
        return "-"
    ends = f" [{error.ratio_ci95[0]:.2f}, {error.ratio_ci95[1]:.2f}]" if error.ratio_ci95 is not None else ""
    followed = f", {error.followed_percent:.0f} % followed" if error.followed_percent is not None else ""
    return f"{error.lon_m:.2f} ({error.coasting_lon_m:.2f}); {error.ratio:.2f}{ends}; {error.n}{followed}"


def hidden_charts(pooled: Pooled) -> Charts:
    """Return each tracker's mean hidden error over the time since the last detection, with intervals over files."""
    lines, rows = lines_of(list(pooled.id_switches)), []
    for error in pooled.hidden:
        if error.to_s is None or not error.n:
            continue
        low, high = error.lon_m_ci95 or (None, None)
        row = {"series": error.tracker, "place": 0.5 * (error.from_s + error.to_s), "mean": error.lon_m}
        rows.append(row | {"low": low, "high": high, "value": f"{error.lon_m:.2f}"})
    title, x = "MAE of longitudinal position while followed, m", "time since the last detection, s"
    tooltip = (("series", "tracker"), ("place", x), ("value", title))
    charts = [curves(title, f"{title}, over the {x}", x, rows, lines, tooltip)] if rows else []
    return Charts(tuple(charts), lines, f"95 % intervals over files; {COASTING_TRACKER} coasts.")
