"""``config.toml``, options and settings merged, checked and filled up with defaults, and written back to a file.

Later layers win: defaults, then the file of ``config``, then the options, then ``settings``.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from harness.common.error_text import first_problem
from harness.common.errors import InputError
from harness.common.files import write_text
from harness.common.untrusted_files import MOST_SETTINGS_BYTES, check_file, checked_path
from harness.config.consent import check_modules, check_sensor_of_folder
from harness.config.model import DEFAULT_TRACKER, RunConfig
from harness.config.options import keys_of_options
from harness.sensor.profiles import is_built_in, sensor_settings
from harness.storage import run_folder as runfolder
from mmpf.settings import fields_of

Table = dict[str, Any]

# Of these keys at most one can hold; a later layer's choice replaces an earlier layer's other.
EXCLUSIVE = ("demand", "density")


def _merged(config_file: Path | None, options: Mapping[str, object], settings: Sequence[str]) -> Table:
    """Return what the user set, unchecked, as one nested table."""
    merged: Table = {}
    in_file = _table_of_file(config_file) if config_file is not None else {}
    for layer in (in_file, _table_of_options(options), _table_of_settings(settings)):
        _forget_another_trackers_options(merged, layer)
        _merge_into(merged, layer)
    return merged


def config_from_table(table: Table) -> RunConfig:
    """Check a nested table and fill in the defaults.

    Raises:
        InputError: A key is unknown or a value is out of bounds; the message names the key or parameter.
    """
    try:
        return RunConfig.model_validate(table)
    except ValidationError as error:
        raise InputError(_first_problem(error)) from None


def _table_of_file(path: Path) -> Table:
    check_file(path, MOST_SETTINGS_BYTES, "config")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise InputError(f"`config`: {path} is nested too deeply") from None
    except OSError as error:
        raise InputError(f"`config`: can't read {path}: {error.strerror}; give the path of a TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"`config`: {path} is not valid TOML: {error}") from None


def write_config(config: RunConfig, path: Path) -> None:
    """Write a configuration so that ``config`` reads the same one back.

    A sensor from outside is written out in full, so that who opens the folder needs no code of others.
    """
    table = config.as_table()
    if not is_built_in(config.sensor.profile):
        figures = sensor_settings(config.sensor.profile, config.sensor.overrides)
        table["sensor"] = {"profile": config.sensor.profile} | figures.model_dump(exclude_none=True)
    write_text(path, tomli_w.dumps(table))


def _table_of_options(options: Mapping[str, object]) -> Table:
    table: Table = {}
    for name, value in options.items():
        if value is not None:
            _put(table, keys_of_options()[name].split("."), value)
    return table


def _table_of_settings(settings: Sequence[str]) -> Table:
    table: Table = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        parts = [part.strip() for part in key.split(".")]
        if not equals or not all(parts):
            raise InputError(f"`settings`: {setting!r} is not KEY=VALUE, for example `settings` sensor.range_m=80")
        _put(table, parts, _toml_value(text.strip()))
    return table


def _toml_value(text: str) -> object:
    """Read a value as TOML would; what is no TOML value is a plain word."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return text


def _put(table: Table, parts: Sequence[str], value: object) -> None:
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


def _first_problem(error: ValidationError) -> str:
    key, message, given, unknown = first_problem(error)
    if unknown:
        return f"unknown key {key!r}{_nearest(key)}"
    parameter = _parameter_of(key)
    place = f"`{parameter}` ({key})" if parameter else key or "configuration"
    return f"{place}: {message}" if isinstance(given, dict) else f"{place}: {message}, not {given!r}"


def _parameter_of(key: str) -> str | None:
    """Return the option that sets a key, if one does."""
    return next((name for name, sets in keys_of_options().items() if sets == key), None)


def _nearest(key: str) -> str:
    known = [name for name, _ in fields_of(RunConfig)]
    near = difflib.get_close_matches(key, known, n=3, cutoff=0.5)
    if not near:
        leaf = key.rsplit(".", 1)[-1]
        near = [name for name in known if difflib.get_close_matches(leaf, [name.rsplit(".", 1)[-1]], cutoff=0.6)]
    return f"; did you mean {' or '.join(near)}?" if near else f"; known keys are {', '.join(known)}"


def resolve_run_config(
    config_file: Path | None = None, options: Mapping[str, object] | None = None, settings: Sequence[str] = ()
) -> RunConfig:
    """Return the checked configuration of a run.

    Args:
        config_file: TOML file of ``config``.
        options: The run's options by name (``net``, ``duration``, ...); None where not given.
        settings: The ``KEY=VALUE`` words of ``settings``.

    Raises:
        InputError: A file can't be read, a key is unknown or a value is out of bounds; or a replay is asked for
            traffic, a sensor or a folder that the recording does not have; or the file is no recorded traffic.
    """
    table = _merged(config_file, options or {}, settings)
    for name in ("traffic", "sensor", "tracker"):
        if not isinstance(table.get(name, {}), dict):
            raise InputError(f"`settings`: {name} is a table of settings, not a value; for example {name}.KEY=VALUE")
    if not isinstance(table.get("traffic", {}).get("recording", {}), dict):
        raise InputError("`settings`: traffic.recording is a table of settings; for example traffic.recording.ego=auto")
    if config_file is not None:
        check_modules(_table_of_file(config_file), _merged(None, options or {}, settings), config_file)
    replay = table.get("replay")
    if isinstance(replay, str):
        path = checked_path(Path(replay), "replay").resolve()
        part = _recorded_part(path, table) if runfolder.is_run_folder(path) else _recorded_traffic_part(path, table)
        table |= part | {"replay": str(path)}
    elif isinstance(traffic := table.get("traffic"), Mapping) and traffic.get("recording"):
        parameter = next(iter(traffic["recording"]))
        raise InputError(f"`{parameter}`: simulated traffic has no such choice; add `replay`, recorded traffic")
    return config_from_table(table)


def _recorded_traffic_part(path: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the traffic's table with the file's format and the network that it is driven on."""
    from harness.truth.recorded.formats import network_of, recognise  # noqa: PLC0415

    traffic = dict(asked.get("traffic", {}))
    recording = {"ego": "auto"} | dict(traffic.get("recording", {}))
    entry = recognise(path, recording.get("format"))
    traffic["recording"] = recording | {"format": entry.name}
    part = {"traffic": traffic | {"net": network_of(entry, traffic.get("net"))}}
    return part if entry.sensor is None else part | _own_detections_part(entry.name, entry.sensor, asked, recording)


def _own_detections_part(
    name: str, sensor: str, asked: Mapping[str, Any], recording: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the sensor's table of a recording that brings its own detections; refuse what it leaves no choice of."""
    if recording["ego"] not in ("auto", "each"):
        raise InputError(f"`ego` {recording['ego']}: a {name} recording is seen from its own car; leave `ego` out")
    profile = asked.get("sensor", {}).get("profile")
    if profile not in (None, sensor):
        raise InputError(f"`sensor` {profile}: a {name} recording brings its own detections; leave `sensor` out")
    return {"sensor": dict(asked.get("sensor", {})) | {"profile": sensor}}


def _recorded_part(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return traffic, sensor and (unless asked otherwise) seed of the recording; refuse what contradicts them."""
    runfolder.read_manifest(folder, "replay")
    config = config_from_table(runfolder.read_config_table(folder, "replay"))
    if asked.get("sensor", {}).get("profile") != config.sensor.profile:
        check_sensor_of_folder(config.sensor, folder, "replay")
    recorded = config.as_table()
    part = {name: recorded[name] for name in ("traffic", "sensor")}
    for key, value in leaves({name: asked[name] for name in part if name in asked}):
        if value != dict(leaves(part)).get(key):
            parameter = _parameter_of(key) or key
            raise InputError(f"`{parameter}`: a replay takes traffic and sensor from the recording; leave it out")
    return part | {"seed": asked.get("seed", recorded["seed"])}


def leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables with their dotted keys.

    Args:
        table: Tables within tables.
        prefix: What stands before each key.
    """
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
