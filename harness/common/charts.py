"""Charts in Vega-Lite's grammar: the browser draws them on a page, and vl-convert draws them as pictures.

Colours are variables of the page, so that a chart follows the reader's light or dark scheme; a picture is light.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import vl_convert

from harness.common.files import replacing

SERIES = tuple(f"var(--series-{place})" for place in range(7))
"""Colours of lines that have no meaning of their own: Okabe and Ito's, and the ink."""
DASHES: tuple[list[int], ...] = ([1, 0], [6, 3], [2, 3], [8, 3, 2, 3])
"""Where there are more lines than colours, neighbours differ in dashes too: what lies over another does not hide it."""
LIGHT = {
    "ink": "#1c1c1c", "edge": "#8a8a8a", "line": "#d9d6d0", "visible": "#009e73", "partial": "#c78500",
    "hidden": "#d55e00", **{f"series-{place}": colour for place, colour in enumerate(
        ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#c78500", "#3a9ad9", "#1c1c1c"))},
}  # fmt: skip
SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
ONLY = "only"
"""Name of the signal that says which line alone is shown strongly."""
FAINT, HIT_AREA = 0.12, 260
MOST_TICKS, COLUMNS = 8, 3
PANEL_WIDTH_PX, PIXELS_PER_INCH = 330, 144
_WORDS = {
    "labelColor": "var(--ink)", "titleColor": "var(--ink)", "titleFontWeight": 500, "labelFontSize": 12,
    "titleFontSize": 12, "domainColor": "var(--edge)", "tickColor": "var(--edge)", "gridColor": "var(--line)",
}  # fmt: skip
CONFIG = {
    "font": "system-ui, sans-serif", "background": "transparent", "view": {"stroke": None}, "axis": _WORDS,
    "text": {"color": "var(--ink)"}, "rule": {"color": "var(--edge)"}, "title": {"color": "var(--ink)"},
}  # fmt: skip

Spec = dict[str, Any]
Row = Mapping[str, Any]


def _pdf(spec: Spec) -> bytes:
    """Return a chart as PDF, with the names of its resources, which vl-convert leaves in any order, sorted in place."""
    names = rb"(?: +/\w+ \d+ 0 R\n)+"
    return re.sub(names, lambda found: b"".join(sorted(found[0].splitlines(True))), vl_convert.vegalite_to_pdf(spec))


_CONVERT: dict[str, Callable[[Spec], bytes]] = {
    "png": lambda spec: vl_convert.vegalite_to_png(spec, ppi=PIXELS_PER_INCH),
    "svg": lambda spec: vl_convert.vegalite_to_svg(spec).encode("utf-8"),
    "pdf": _pdf,
}
KINDS = tuple(_CONVERT)
"""Formats of pictures."""


@dataclass(frozen=True)
class Chart:
    """A chart: its title with the unit, what it shows for those who do not see it, and its Vega-Lite specification.

    ``better`` says which values are better, where that is so.

    Rows whose field ``cells`` is a list of numbers lead to these cells of the page's grid when clicked, rows with a
    field ``at`` to that moment of its replay.
    """

    title: str
    description: str
    spec: Spec
    better: str = ""


@dataclass(frozen=True)
class Charts:
    """Charts that stand together on a page.

    Attributes:
        lines: Name and colour of each line, for the legend that they share; empty where they need none.
        note: What they show, with the kind of interval.
        hint: What a reader of the page may do with them.
        wide: Whether each takes a row of its own.
    """

    charts: tuple[Chart, ...]
    lines: tuple[tuple[str, str], ...] = ()
    note: str = ""
    hint: str = ""
    wide: bool = False


def lines_of(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return names with colours of their own."""
    return tuple((name, SERIES[place % len(SERIES)]) for place, name in enumerate(names))


def curves(
    title: str,
    description: str,
    x: str,
    rows: Sequence[Row],
    lines: Sequence[tuple[str, str]],
    tooltip: Sequence[tuple[str, str]],
    limit: tuple[float, str] | None = None,
    marks: Sequence[tuple[float, str]] = (),
    better: str = "",
) -> Chart:
    """Return a chart of one line for each series with the band of its interval; points where the axis is categorical.

    Lines of what ends in % have an axis to 100; all other axes follow the values and their intervals. Rows have the
    fields ``series``, ``place`` (a number or a word), ``mean``, ``low`` and ``high`` (None without an interval),
    ``piece`` where lines have gaps, and what the tooltip tells, by its names. ``limit`` is a horizontal line and what
    it says, ``marks`` are moments at which vertical lines stand.
    """
    places = list(dict.fromkeys(row["place"] for row in rows))
    in_words = any(isinstance(place, str) for place in places)
    x_axis: Spec = {"field": "place", "title": x, "type": "nominal" if in_words else "quantitative", "sort": None}
    if in_words:
        x_axis |= {"axis": {"labelAngle": 0, "grid": False}, "scale": {"domain": places}}
    else:
        ticks = {"values": sorted(places)} if len(places) <= MOST_TICKS else {"tickCount": MOST_TICKS - 1}
        x_axis |= {"scale": {"zero": False, "nice": False, "padding": 12}, "axis": {"grid": False, **ticks}}
    names = [name for name, _ in lines]
    y: Spec = {"type": "quantitative", "title": None, "scale": {"zero": True}}
    y["scale"] |= {"domain": [0, 102]} if title.endswith("%") and not in_words else {}
    if all(not row["mean"] and not row.get("high") for row in rows):
        y["scale"]["domain"] = [0, 1]
    common: Spec = {"x": x_axis, "color": colour_by("series", lines)}
    if in_words and len({(row["place"], row["series"]) for row in rows}) > len(places):
        common["xOffset"] = {"field": "series", "scale": {"domain": names}}
    mean, low = {**y, "field": "mean"}, {**y, "field": "low"}
    dashes = [DASHES[place % len(DASHES) if len(lines) > len(SERIES) else 0] for place in range(len(lines))]
    dash: Spec = {"field": "series", "type": "nominal", "scale": {"domain": names, "range": dashes}, "legend": None}
    layers = _marked(marks)
    if any(row.get("low") is not None for row in rows):
        mark: Spec = {"type": "rule", "strokeWidth": 1.6} if in_words else {"type": "area", "tooltip": None}
        opacity = strength("series", 1.0 if in_words else 0.16)
        layers.append({"mark": mark, "encoding": {**common, "y": low, "y2": {"field": "high"}, "opacity": opacity}})
    if not in_words:
        split = {"detail": {"field": "piece", "type": "nominal"}} if "piece" in rows[0] else {}
        line = {**common, **split, "y": mean, "strokeDash": dash, "opacity": strength("series")}
        layers.append({"mark": {"type": "line", "strokeWidth": 2}, "encoding": line})
    dot = {**common, "y": mean, "opacity": strength("series")}
    layers.append({"mark": {"type": "point", "filled": True, "size": 40}, "encoding": dot})
    layers += _limited(limit, y)
    hit: Spec = {"type": "point", "filled": True, "size": HIT_AREA, "opacity": 0, "cursor": "pointer"}
    layers.append({"mark": hit, "encoding": {**common, "y": mean, "tooltip": tooltip_of(*tooltip)}})
    return Chart(title, description, spec_of(description, rows, layers), better)


def _limited(limit: tuple[float, str] | None, y: Spec) -> list[Spec]:
    if limit is None:
        return []
    at: Spec = {"y": {**y, "datum": limit[0]}}
    text = {"type": "text", "text": limit[1], "align": "left", "dx": 4, "dy": 10, "fontSize": 11}
    return [
        {"data": {"values": [{}]}, "mark": {"type": "rule", "strokeDash": [3, 3]}, "encoding": at},
        {"data": {"values": [{}]}, "mark": text, "encoding": at | {"x": {"value": 0}}},
    ]


def _marked(marks: Sequence[tuple[float, str]]) -> list[Spec]:
    if not marks:
        return []
    data = {"values": [{"place": place, "text": text} for place, text in marks]}
    text = {"type": "text", "align": "left", "baseline": "top", "dx": 3, "fontSize": 11}
    at: Spec = {"x": {"field": "place", "type": "quantitative"}}
    said = at | {"y": {"value": 0}, "text": {"field": "text"}}
    return [
        {"data": data, "mark": {"type": "rule", "strokeDash": [2, 3]}, "encoding": at},
        {"data": data, "mark": text, "encoding": said},
    ]


def spec_of(description: str, rows: Sequence[Row], layers: Sequence[Spec], height: int = 220) -> Spec:
    """Return a specification as wide as its place, of layers from the bottom up, with a plot so many pixels high."""
    return {
        "$schema": SCHEMA,
        "description": description,
        "width": "container",
        "height": height,
        "autosize": {"type": "fit", "contains": "padding"},
        "params": [{"name": ONLY, "value": None}],
        "config": CONFIG,
        "data": {"values": list(rows)},
        "layer": list(layers),
    }


def colour_by(field_name: str, lines: Sequence[tuple[str, str]]) -> Spec:
    """Return the colour of each line's marks; the legend stands on the page."""
    names, colours = [name for name, _ in lines], [colour for _, colour in lines]
    return {"field": field_name, "type": "nominal", "scale": {"domain": names, "range": colours}, "legend": None}


def strength(field_name: str, strong: float = 1.0) -> Spec:
    """Return the opacity of a line's marks: faint while another line is selected."""
    chosen = f"!{ONLY} || datum['{field_name}'] == {ONLY}"
    return {"condition": {"test": chosen, "value": strong}, "value": FAINT * strong}


def tooltip_of(*columns: tuple[str, str]) -> list[Spec]:
    """Return the tooltip of a row: fields with their labels."""
    return [{"field": name, "type": "nominal", "title": title} for name, title in columns]


def draw_charts(group: Charts, title: str, path: Path) -> None:
    """Draw charts as one picture with a heading and a legend, of a kind in ``KINDS``; the same bytes each time."""
    own = ("$schema", "autosize", "params", "config", "description")
    panels = [
        {name: value for name, value in chart.spec.items() if name not in own}
        | {"layer": [layer for layer in chart.spec["layer"] if layer["mark"].get("opacity") != 0]}
        | {"title": {"text": chart.title, "subtitle": chart.better or None, "frame": "group", "fontSize": 12}}
        | {"width": PANEL_WIDTH_PX}
        for chart in group.charts
    ]
    spec: Spec = {
        "$schema": SCHEMA,
        # One weight: vl-convert writes a PDF of several fonts in another order each time.
        "config": CONFIG
        | {"background": "white", "font": "sans-serif"}
        | {"title": {"fontWeight": "normal", "subtitleColor": "#5a5a5a", "anchor": "start"}},
        "title": {"text": title, "subtitle": group.note, "offset": 14, "fontSize": 15},
        "params": [{"name": ONLY, "value": None}],
        "columns": COLUMNS,
        "concat": panels,
        "bounds": "flush",
        "spacing": {"row": 80, "column": 60},
        "resolve": {"scale": {"color": "shared", "strokeDash": "shared"}},
    }
    legend: Spec = {"orient": "bottom", "title": None, "columns": 4, "labelLimit": 400, "symbolOpacity": 1}
    legend |= {"symbolType": "stroke", "symbolSize": 500, "symbolStrokeWidth": 2.5, "labelFontSize": 12}
    text = json.dumps(spec)
    if group.lines:
        text = text.replace('"legend": null', f'"legend": {json.dumps(legend)}')
    text = re.sub(r"var\(--([\w-]+)\)", lambda found: LIGHT[found[1]], text)
    content = _CONVERT[path.suffix.removeprefix(".")](json.loads(text))
    with replacing(path) as temporary:
        temporary.write_bytes(content)
