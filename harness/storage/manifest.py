"""The manifest of a run: versions, revision, inputs, machine and wall times."""

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.common.files import write_text
from harness.common.isolation import ProcessLimits, isolated
from harness.common.streams import to_stderr
from harness.common.untrusted_files import read_json

PACKAGES = ("mmpf-harness", "libsumo", "numpy", "scipy", "numba", "pandas", "pyarrow", "scikit-learn")
CODE, INPUTS, FILES = "code_sha256", "inputs_sha256", "files_sha256"
HASHED = ("metrics.json", "config.toml", "road.json", "grid.json")


@dataclass(frozen=True)
class RunFacts:
    """Facts about a run or grid apart from software and machine.

    Attributes:
        status: ``complete``, ``interrupted`` or ``failed``; ``problem`` is what ended it, if not itself.
        command: What was typed, or what makes the same.
        steps: Finished steps; of a grid, finished runs.
        inputs: SHA-256 of each input file.
        rows: Rows of each of the run's tables, by file.
        code: SHA-256 of the code that decides results, by package or module.
        files: SHA-256 of each file of results, by which one that was edited is recognised.
        is_log: Whether its tracks are a log's, so that nobody knows how long their tracker took.
    """

    status: str
    command: str
    seed: int
    steps: int
    inputs: Mapping[str, str] = field(default_factory=dict)
    wall_times_s: Mapping[str, float] = field(default_factory=dict)
    problem: str | None = None
    rows: Mapping[str, int] = field(default_factory=dict)
    code: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    is_log: bool = False


def write_manifest(path: Path, facts: RunFacts) -> None:
    """Write ``manifest.json``."""
    manifest = {
        "status": facts.status, "problem": facts.problem, "command": facts.command, "is_log": facts.is_log,
        "seed": facts.seed, "steps": facts.steps, "rows": dict(facts.rows),
        "versions": {name: _version(name) for name in PACKAGES} | {"python": platform.python_version()},
        "git_revision": _git_revision(), CODE: dict(facts.code), INPUTS: dict(facts.inputs), FILES: dict(facts.files),
        "machine": {"system": platform.platform(), "processor": _processor(), "cores": os.cpu_count()},
        "wall_times_s": {name: round(seconds, 3) for name, seconds in facts.wall_times_s.items()},
    }  # fmt: skip
    write_text(path, json.dumps(manifest, indent=2) + "\n")


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def manifest_of(folder: Path, parameter: str | None = None) -> dict[str, Any]:
    """Return the manifest of a folder; empty where it is broken or missing: a baseline may be a table of runs alone."""
    try:
        manifest = read_json(folder / "manifest.json", parameter)
    except (OSError, ValueError):
        return {}
    return manifest if all(isinstance(manifest.get(name) or {}, dict) for name in (CODE, INPUTS, FILES)) else {}


def hashes_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each table of a folder, of its scores and its settings, by file."""
    return {path.name: sha256_of(path) for path in _hashed(folder)}


def _hashed(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.glob("*")) if path.name in HASHED or path.suffix == ".parquet"]


def unproven(folder: Path, manifest: Mapping[str, Any]) -> list[str]:
    """Return a sentence on results in a folder that may have been edited unseen; none where each has its hash."""
    noted = [Path(str(name)).name for name in manifest.get(FILES) or ()]
    if not (unknown := [path.name for path in _hashed(folder) if path.name not in noted]):
        return []
    more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
    return [f"{folder}: there is no SHA-256 of {unknown[0]}{more}, so nobody can tell whether somebody changed it."]


def tell_edited(folder: Path, parameter: str) -> None:
    """Write a line to stderr if the results in a folder were edited, or may have been unseen."""
    manifest = manifest_of(folder)
    try:
        check_unedited(folder, manifest, parameter)
        told = unproven(folder, manifest) if manifest.get("status") == "complete" else []
    except InputError as error:
        told = [str(error).replace("`", "")]
    for line in told:
        to_stderr(f"warning: {line}")


def check_unedited(folder: Path, manifest: Mapping[str, object], parameter: str) -> None:
    """Refuse a folder whose results are not those that its run or grid wrote; one that noted no hashes says nothing.

    Raises:
        InputError: A file was edited, or the manifest can't be read.
    """
    noted = manifest.get(FILES, {})
    if not isinstance(noted, dict) or (not manifest and (folder / "manifest.json").exists()):
        raise InputError(f"`{parameter}`: {folder / 'manifest.json'} is broken; make the results again")
    told = {folder / Path(str(name)).name: digest for name, digest in noted.items()}
    files = [path for path in told if path.is_file()]
    place, limits = f"`{parameter}`: {folder}", ProcessLimits.for_files(files)
    if changed := isolated(lambda: [path for path in files if sha256_of(path) != told[path]], place, limits):
        raise InputError(
            f"`{parameter}`: {changed[0]} was changed after it was written (its SHA-256 is another than in "
            f"manifest.json); make it again, or take {FILES} out of manifest.json if you meant that"
        )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git_revision() -> str | None:
    """Return the revision of the source tree with ``-dirty`` where it was changed; None for an installed package."""
    # An installed package may lie inside somebody else's repository, whose revision says nothing about it.
    if _git("ls-files", "--error-unmatch", Path(__file__).name) is None:
        return None
    return _git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def _git(*arguments: str) -> str | None:
    """Return git's output in this file's folder; None if it fails."""
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=10.0, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.strip() if answer.returncode == 0 else None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
