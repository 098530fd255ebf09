"""What people are told of a metric's numbers: names, units, directions, and which tables they stand in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Quantity:
    """A number of ``metrics.json`` as one or several tables show it.

    A number that tables weigh or name differently is declared once for each way.

    Attributes:
        key: Its keys in ``metrics.json``, joined by dots.
        label: Its name with its unit, for people.
        higher_is_better: Its direction.
        decimals: How many are shown; verdicts show one more.
        heading: Its name and unit, short enough for a column.
        weight: Key of the samples behind it, by which runs are averaged; empty where every run counts the same.
        scale: Given where the number is a count: what count over ``weight`` is multiplied by, 100 for percent.
        compared: Whether ``compare`` gives a verdict on it.
        curve: Whether ``stress`` draws and tabulates it over each axis, under ``heading``.
        tabled: Whether ``stress`` tabulates it with its interval over seeds without drawing it.
        pooled: What it is called in the pooled scores over recorded traffic; empty leaves it out of them.
        ablated: Whether the ablation study tabulates it.
        reported: Whether a run's page and its summary on the screen show it, multi-object scores under ``heading``.
        optional: Whether tables in which nothing has a value leave it out.
        of_kind: The words of its label that say of which kind of vehicles it tells; tables with a row for each kind
            leave them out of their headings.
    """

    key: str
    label: str
    higher_is_better: bool = False
    decimals: int = 1
    heading: str = ""
    weight: str = ""
    scale: float | None = None
    compared: bool = False
    curve: bool = False
    tabled: bool = False
    pooled: str = ""
    ablated: bool = False
    reported: bool = False
    optional: bool = False
    of_kind: str = ""

    def of(self, metrics: Mapping[str, Any]) -> float | None:
        """Return its value in the content of a ``metrics.json``; None where there is none."""
        value: Any = metrics
        for part in self.key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        return None if value is None else float(value)
