"""A chart as a page holds it: a specification in Vega-Lite's grammar, and the library that draws it in the browser.

Colours are the page's own variables, so that a chart follows the reader's light or dark scheme, and paper, by itself.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

LIBRARY = Path(__file__).parent / "vega" / "vega-embed.js.gz"
SERIES = tuple(f"var(--series-{place})" for place in range(7))
"""Colours of lines that have no meaning of their own: Okabe and Ito's, and the ink."""
STATES = {"visible": "var(--visible)", "partly hidden": "var(--partial)", "hidden": "var(--hidden)"}
SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
ONLY = "only"
"""Name of the signal that says which line alone is shown strongly."""
FAINT, HIT_AREA = 0.12, 260

Spec = dict[str, Any]


@dataclass(frozen=True)
class Chart:
    """A chart.

    Attributes:
        title: What it shows, with its unit.
        description: The same for those who do not see it.
        spec: Its specification in Vega-Lite's grammar. Rows whose field ``cells`` is a list of numbers lead to these
            cells of the page's grid when clicked, rows with a field ``at`` to that moment of its replay.
    """

    title: str
    description: str
    spec: Spec


@dataclass(frozen=True)
class Charts:
    """Charts that stand together on a page.

    Attributes:
        charts: The charts.
        lines: Name and colour of each line, for the legend that they share; empty where they need none.
        note: What a reader may do with them, a sentence or two.
        wide: Whether each takes a row of its own.
    """

    charts: tuple[Chart, ...]
    lines: tuple[tuple[str, str], ...] = ()
    note: str = ""
    wide: bool = False


def charts_data(groups: Sequence[Charts]) -> list[Spec]:
    """Return the specifications of all charts, in the order in which their places stand on the page."""
    return [chart.spec for group in groups for chart in group.charts]


@cache
def library() -> str:
    """Return the compressed library as base64, as a page carries it."""
    return base64.b64encode(LIBRARY.read_bytes()).decode("ascii")


def spec_of(description: str, rows: Sequence[Mapping[str, Any]], layers: Sequence[Spec], height: int = 220) -> Spec:
    """Return a specification as wide as its place.

    Args:
        description: What it shows, for those who do not see it.
        rows: The data.
        layers: What is drawn, from the bottom up.
        height: Of the plot, in pixels.
    """
    return {
        "$schema": SCHEMA,
        "description": description,
        "width": "container",
        "height": height,
        "autosize": {"type": "fit", "contains": "padding"},
        "params": [{"name": ONLY, "value": None}],
        "data": {"values": list(rows)},
        "layer": list(layers),
    }


def colour_by(field_name: str, lines: Sequence[tuple[str, str]]) -> Spec:
    """Return the colour of each line's marks; the legend stands on the page."""
    names, colours = [name for name, _ in lines], [colour for _, colour in lines]
    return {"field": field_name, "type": "nominal", "scale": {"domain": names, "range": colours}, "legend": None}


def strength(field_name: str, strong: float = 1.0) -> Spec:
    """Return the opacity of a line's marks: faint while another one alone is asked for."""
    chosen = f"!{ONLY} || datum['{field_name}'] == {ONLY}"
    return {"condition": {"test": chosen, "value": strong}, "value": FAINT * strong}


def told(*columns: tuple[str, str]) -> list[Spec]:
    """Return what is told of a row that is pointed at: fields with their names in words."""
    return [{"field": name, "type": "nominal", "title": title} for name, title in columns]
