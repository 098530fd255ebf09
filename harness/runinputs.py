"""What a run is driven by, from wherever it comes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from harness.sensor.observation import Sensor
from harness.truth.frame import TruthSource


@dataclass(frozen=True)
class RunInputs:
    """Truth and sensor of a run.

    Attributes:
        truth: Yields the frames.
        sensor: Looks at them.
        files: The files that decided them, by a name for the manifest.
        report: What the user should know about them; empty if nothing.
        about: Tables about them for ``metrics.json``, by name.
    """

    truth: TruthSource
    sensor: Sensor
    files: Mapping[str, Path] = field(default_factory=dict)
    report: str = ""
    about: Mapping[str, object] = field(default_factory=dict)

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of each input file."""
        return {name: _sha256(path) for name, path in self.files.items()}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
