"""Numbers as text, and as JSON: plain values, and null for what is not finite."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def number(value: float | None, decimals: int, unit: str = "", sign: str = "") -> str:
    """Return a number with its unit, or a dash for none; the sign ``+`` is written where it is asked for."""
    return "-" if value is None or math.isnan(value) else f"{value:{sign}.{decimals}f}{unit}"


def as_json(metrics: Mapping[str, Any]) -> str:
    """Return the text of ``metrics.json``."""
    return json.dumps(metrics, indent=2, allow_nan=False) + "\n"


def without_nan(value: Any) -> Any:  # noqa: ANN401
    """Return nested plain values with NumPy scalars made plain and what is not finite made None."""
    if isinstance(value, Mapping):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def rounded(value: Any, decimals: int) -> Any:  # noqa: ANN401  nested plain values
    """Return nested plain values with every number in them rounded, and tuples as lists."""
    if isinstance(value, Mapping):
        return {name: rounded(item, decimals) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(item, decimals) for item in value]
    return round(value, decimals) if isinstance(value, float) else value
