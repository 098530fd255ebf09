"""Co-simulation that evaluates multi-vehicle tracking through occlusion: truth, sensor, tracker, score, report.

The public names are imported on first use, so that ``import harness`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.api import Comparison, Grid, Run, compare, open_run, run, stress
    from harness.common.errors import InputError, RunError, RunInterruptedError
    from harness.config.options import RunOptions
    from harness.grid.options import GridOptions

_HOME = {
    "Comparison": "harness.api",
    "Grid": "harness.api",
    "GridOptions": "harness.grid.options",
    "InputError": "harness.common.errors",
    "Run": "harness.api",
    "RunError": "harness.common.errors",
    "RunInterruptedError": "harness.common.errors",
    "RunOptions": "harness.config.options",
    "compare": "harness.api",
    "open_run": "harness.api",
    "run": "harness.api",
    "stress": "harness.api",
}

__all__ = [
    "Comparison",
    "Grid",
    "GridOptions",
    "InputError",
    "Run",
    "RunError",
    "RunInterruptedError",
    "RunOptions",
    "compare",
    "open_run",
    "run",
    "stress",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  the type is the name's own
    if name not in _HOME:
        raise AttributeError(f"module 'harness' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
