"""Which modules a configuration file may name: installed ones, and those that the user names in person as well.

A name such as ``package.module:factory`` is imported, which runs the module. A file may come from anybody; the working
folder, which Python puts before all others, may hold what came with it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from harness.common.errors import InputError

# Where a configuration may name a module, and the option that names it in person.
OPTIONS = {
    "tracker.name": "tracker",
    "tracker.model": "model",
    "sensor.profile": "sensor",
    "traffic.recording.format": "format",
}


def check_modules(in_file: Mapping[str, Any], chosen: Mapping[str, Any], file: Path) -> None:
    """Refuse a module of the working folder that only the file names.

    Args:
        in_file: The file's content.
        chosen: What the user's options and settings say, without the file.
        file: The file, for the message.

    Raises:
        InputError: Such a module would be imported.
    """
    for key, option in OPTIONS.items():
        name = _at(in_file, key)
        if _at(chosen, key) is not None:
            continue
        if isinstance(name, str) and ":" in name and (name.startswith("exec:") or not is_installed(name)):
            raise InputError(
                f"`config`: {file} names {name}, which is no installed module, and it would be run; if you trust it, "
                f"give it yourself as `{option}`"
            )


def _at(table: Mapping[str, Any], key: str) -> object:
    """Return what nested tables hold under a dotted key; None for nothing."""
    value: object = table
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def is_installed(name: str) -> bool:
    """Return whether a module is found without the working folder; nothing of it is imported.

    Args:
        name: ``package.module:attribute``.
    """
    top = name.partition(":")[0].partition(".")[0]
    if not top.isidentifier():
        return False
    if top in sys.builtin_module_names:
        return True
    here = Path.cwd().resolve()
    chosen = {Path(entry).resolve() for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry}
    path = [entry for entry in sys.path if entry and (Path(entry).resolve() != here or here in chosen)]
    if PathFinder.find_spec(top, path) is not None:
        return True
    # Packages that are installed for editing are found by finders of their own.
    others = [finder for finder in sys.meta_path if finder is not PathFinder]
    return any(finder.find_spec(top, None) is not None for finder in others if hasattr(finder, "find_spec"))
