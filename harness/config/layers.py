"""Merges and checks ``config.toml``, options and settings.

Later layers win: defaults, then the file of ``config``, then the options, then ``settings``.

Settings files may not name code to run: only the command line may. A name such as ``package.module:factory`` is
imported and called, and ``exec:`` starts a program. A file may come from anybody, and so may what lies beside it; what
is installed can do harm as well if it is called.
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from harness.common.error_text import first_problem, nearest
from harness.common.errors import InputError
from harness.common.untrusted_files import read_toml
from harness.config.model import DEFAULT_TRACKER, RunConfig, TrackerConfig
from harness.config.options import keys_of_options
from harness.config.sensor import SensorSettings
from mmpf.options.base import fields_of, names_code

Table = dict[str, Any]

# Of these keys at most one can hold; a later layer's choice replaces an earlier layer's other.
EXCLUSIVE = ("demand", "density")


def merged(config_file: Path | None, options: Mapping[str, object], settings: Sequence[str]) -> Table:
    """Return what the user set, unchecked, as one nested table."""
    merged: Table = {}
    in_file = read_toml(config_file, "config") if config_file is not None else {}
    by_options: Table = {}
    for name, value in options.items():
        if value is not None:
            put(by_options, keys_of_options()[name].split("."), value)
    for layer in (in_file, by_options, _table_of_settings(settings)):
        _forget_another_trackers_options(merged, layer)
        _merge_into(merged, layer)
    return merged


def config_from_table(table: Table) -> RunConfig:
    """Check a nested table and fill in the defaults."""
    try:
        return RunConfig.model_validate(table)
    except ValidationError as error:
        key, message, given, unknown = first_problem(error)
        if unknown:
            known = [name for name, _ in fields_of(RunConfig)]
            at = known.index("sensor.profile")
            known[at:at] = [name for name, _ in fields_of(SensorSettings, "sensor.")]
            raise InputError(f"unknown key {key!r}{nearest(key, known)}") from None
        parameter = parameter_of(key)
        place = f"`{parameter}` ({key})" if parameter else key or "configuration"
        told = f"{place}: {message}"
        raise InputError(told if isinstance(given, dict) else f"{told}, not {given!r}") from None


def _table_of_settings(settings: Sequence[str]) -> Table:
    table: Table = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        parts = [part.strip() for part in key.split(".")]
        if not equals or not all(parts):
            raise InputError(f"`settings`: {setting!r} is not KEY=VALUE, for example `settings` sensor.range_m=80")
        put(table, parts, _toml_value(text.strip()))
    return table


def _toml_value(text: str) -> object:
    """Read a value as TOML would; what is no TOML value is a plain word."""
    try:
        read = tomllib.loads(f"value = {text}")
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return text
    if len(read) > 1:
        raise InputError(f"`settings`: {text[:60]!r} sets more than one thing; give `settings` once for each")
    return read["value"]


def put(table: Table, parts: Sequence[str], value: object) -> None:
    """Put a value into nested tables, under a key in parts."""
    for part in parts[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise InputError(f"`settings`: {'.'.join(parts)} lies below {part}, which is set to a value")
    table[parts[-1]] = value


def _forget_another_trackers_options(merged: Table, layer: Table) -> None:
    """Drop earlier layers' tracker table where the layer names another tracker, whose options are others."""
    earlier, later = merged.get("tracker"), layer.get("tracker")
    if isinstance(earlier, dict) and isinstance(later, dict):
        present = earlier.get("name", DEFAULT_TRACKER)
        if later.get("name", present) != present:
            # What is believed of the sensor is no option of the tracker's own.
            merged["tracker"] = {name: earlier[name] for name in ("believes",) if name in earlier}


def _merge_into(merged: Table, layer: Table) -> None:
    for key, value in layer.items():
        if isinstance(value, dict) and isinstance(merged.get(key), dict):
            _merge_into(merged[key], value)
            continue
        if key in EXCLUSIVE:
            for other in set(EXCLUSIVE) - {key} - set(layer):
                merged.pop(other, None)
        merged[key] = value


def parameter_of(key: str) -> str | None:
    """Return the option that sets a key, if one does."""
    return next((name for name, sets in keys_of_options().items() if sets == key), None)


def leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables with their dotted keys, each after a prefix."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def keys_of_code() -> Iterator[str]:
    """Yield the keys that may name code; those of a tracker may stand among its options too."""
    yield from (key for key, field in fields_of(RunConfig) if names_code(field))
    yield from (f"tracker.options.{key}" for key, field in fields_of(TrackerConfig) if names_code(field))


def check_modules(in_file: Mapping[str, Any], chosen: Mapping[str, Any], file: Path) -> None:
    """Refuse code that only a file's content names, and not what the user chose by options and settings."""
    named, given = dict(leaves(in_file)), dict(leaves(chosen))
    for key in keys_of_code():
        name = named.get(key)
        if isinstance(name, str) and ":" in name and given.get(key) is None:
            option = parameter_of(key)
            own = f"`{option}`" if option else f"`settings` {key}={name[:60]}"
            raise InputError(
                f"`config`: {file} has {key} = {name[:60]}, and using that runs code; if you trust it, give it "
                f"yourself as {own}"
            )
