"""Samples from recorded traffic, in any format that ``run --replay`` takes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from harness.errors import UserError
from harness.fidelity.samples import Sampler, Samples, merged
from harness.truth.recorded.formats import network_of, read_traffic, recognise
from harness.truth.recorded.resample import STEP_S
from harness.truth.recorded.traffic import assemble

WHOLE_S = 86_400.0
SUFFIXES = (".xml", ".csv", ".txt")


def recording_files(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the files that are meant by files and folders of them.

    Raises:
        UserError: A path does not exist or a folder holds no recording.
    """
    found: list[Path] = []
    for path in paths:
        if not path.exists():
            raise UserError(f"--recordings {path}: does not exist; give files or folders of recorded traffic")
        inside = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES) if path.is_dir() else [path]
        if not inside:
            raise UserError(f"--recordings {path}: the folder holds no recorded traffic")
        found += inside
    return tuple(found)


def recorded_samples(files: Iterable[Path], net: str) -> Samples:
    """Return the samples of all recordings as one.

    Raises:
        UserError: One is no recording or is broken.
    """
    return merged(_samples(path, net) for path in files)


def _samples(path: Path, net: str) -> Samples:
    entry = recognise(path)
    traffic = assemble(
        read_traffic(path, entry.name, network_of(entry, None if entry.brings_road else net)), path, WHOLE_S
    )
    sampler = Sampler(traffic.window_m, STEP_S)
    for _ in sampler.tap(traffic.frame(step, step, 0, int(traffic.stay[0])) for step in range(traffic.steps)):
        pass
    return sampler.samples()
