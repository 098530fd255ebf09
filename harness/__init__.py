"""Co-simulation that evaluates multi-vehicle tracking through occlusion: truth, sensor, tracker, score, report.

The public names are those of ``harness.api``, imported on first use, so that ``import harness`` costs nothing.
"""

from __future__ import annotations

import importlib

# As ``typing.TYPE_CHECKING``, without the time that loading ``typing`` takes.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from harness.api import *  # noqa: F403


def __getattr__(name: str) -> Any:  # noqa: ANN401  the type is the name's own
    if name == "__all__" or not name.startswith("_"):
        api = importlib.import_module("harness.api")
        if name == "__all__" or name in api.__all__:
            return getattr(api, name)
    raise AttributeError(f"module 'harness' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*importlib.import_module("harness.api").__all__, *(name for name in globals() if name[0] == "_")})
