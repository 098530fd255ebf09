"""Settings files may not name code to run: only the command line may.

A name such as ``package.module:factory`` is imported and called, and ``exec:`` starts a program. A file may come from
anybody, and so may what lies beside it; what is installed can do harm as well if it is called.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.config.layers import parameter_of
from harness.config.model import RunConfig, TrackerConfig
from mmpf.options.base import fields_of, names_code


def keys_of_code() -> Iterator[str]:
    """Yield the keys that may name code; those of a tracker may stand among its options too."""
    yield from (key for key, field in fields_of(RunConfig) if names_code(field))
    yield from (f"tracker.options.{key}" for key, field in fields_of(TrackerConfig) if names_code(field))


def check_modules(in_file: Mapping[str, Any], chosen: Mapping[str, Any], file: Path) -> None:
    """Refuse code that only a file names.

    Args:
        in_file: The file's content.
        chosen: What the user's options and settings say, without the file.
        file: The file, for the message.

    Raises:
        InputError: It would be imported.
    """
    for key in keys_of_code():
        name = _at(in_file, key)
        if isinstance(name, str) and ":" in name and _at(chosen, key) is None:
            option = parameter_of(key)
            own = f"`{option}`" if option else f"`settings` {key}={name[:60]}"
            raise InputError(
                f"`config`: {file} has {key} = {name[:60]}, and using that runs code; if you trust it, give it "
                f"yourself as {own}"
            )


def _at(table: Mapping[str, Any], key: str) -> object:
    """Return what nested tables hold under a dotted key; None for nothing."""
    value: object = table
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value
