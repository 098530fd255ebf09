"""Hashes of the code and model files that determine the results of a run."""

import hashlib
import re
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from harness.config.layers import leaves
from harness.config.model import RunConfig
from harness.storage.manifest import sha256_of

PARTS = ("mmpf", *(f"harness/{part}" for part in ("truth", "sensor", "scoring", "trackers", "decisions", "closedloop")))
"""Packages that decide results."""
_NAMED = re.compile(r"([A-Za-z_][\w.]*):[\w.]+")
MODEL_FILE = "tracker.model_file"


@cache
def own_code() -> dict[str, str]:
    """Return the SHA-256 of the project's own code and packaged models, by package."""
    root = Path(__file__).parents[2]
    return {name: _of_folder(root / name) for name in PARTS}


def other_code(config: RunConfig) -> dict[str, str]:
    """Return the SHA-256 of the user's own modules that a configuration names and that are loaded, by module.

    Of a module within a package it is that of the whole package.
    """
    found: dict[str, str] = {}
    for _, value in leaves(config.as_table()):
        named = _NAMED.fullmatch(value) if isinstance(value, str) else None
        module = sys.modules.get(named[1]) if named else None
        file = getattr(module, "__file__", None)
        if named is None or module is None or not file or named[1].partition(".")[0] in ("harness", "mmpf"):
            continue
        top = getattr(sys.modules.get(named[1].partition(".")[0]), "__path__", None)
        found[named[1]] = _of_folder(Path(next(iter(top)))) if top else sha256_of(Path(file))
    return found


def model_files(config: RunConfig) -> dict[str, str]:
    """Return the SHA-256 of the file of a fitted model that a configuration names, by path; none if it is not there."""
    file = dict(leaves(config.as_table())).get(MODEL_FILE)
    return {file: sha256_of(Path(file))} if file and Path(file).is_file() else {}


def provenance_of(configs: Iterable[RunConfig]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the SHA-256 of all code, and of all model files, that configurations rest on."""
    code, files = dict(own_code()), dict[str, str]()
    for config in configs:
        code |= other_code(config)
        files |= model_files(config)
    return code, files


def _of_folder(folder: Path) -> str:
    """Return the SHA-256 of all source and model files in a folder, names included."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".npz", ".toml", ".json")):
        digest.update(f"{path.relative_to(folder)}\0{sha256_of(path)}\n".encode())
    return digest.hexdigest()
