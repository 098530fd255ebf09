"""The file that a calibration leaves: drivers and demands, as the network loads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.fidelity.candidate import Candidate

HEADER = """\
# Made by `python -m harness calibrate --write`; the procedure is in docs/traffic.md.
# It takes the place of what network.toml says about drivers and about demands of these names.
"""


def as_table(candidate: Candidate) -> dict[str, Any]:
    """Return a candidate as the tables of ``calibration.toml``."""
    return {
        "drivers": candidate.drivers.model_dump(),
        "demands": {
            name: demand.model_dump(mode="json", exclude_none=True) for name, demand in candidate.demands.items()
        },
    }


def write_candidate(path: Path, candidate: Candidate) -> None:
    """Write a candidate as ``calibration.toml``."""
    import tomli_w  # noqa: PLC0415

    path.write_text(HEADER + "\n" + tomli_w.dumps(as_table(candidate)), encoding="utf-8")
