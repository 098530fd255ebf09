"""The figures of one run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from harness.moment import Moment
from mmpf.road import Road
from mmpf.scan import SensorModel


def draw_figures(
    folder: Path,
    moment: Moment | None,
    road: Road,
    sensor: SensorModel,
    errors: pd.DataFrame,
    scores: Mapping[str, Any],
) -> None:
    """Draw everything."""
