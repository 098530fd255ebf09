"""Numbers as JSON: plain values, and null for what is not finite."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


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
