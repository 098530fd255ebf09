"""The configuration of a run that may be a replay: of an earlier run, or of traffic recorded on a real road."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness import runfolder
from harness.config import RunConfig
from harness.configfile import OPTION_OF_KEY, config_from_table, merge_layers
from harness.errors import UserError


def resolve_run_config(
    config_file: Path | None = None, options: Mapping[str, object] | None = None, settings: Sequence[str] = ()
) -> RunConfig:
    """Return the checked configuration of a run.

    Args:
        config_file: TOML file of ``--config``.
        options: The command's options by name without dashes (``net``, ``duration``, ...); None where not given.
        settings: The ``KEY=VALUE`` words of ``--set``.

    Raises:
        UserError: A file can't be read, a key is unknown or a value is out of bounds; or a replay is asked for
            traffic, a sensor or a folder that the recording does not have; or the file is no recorded traffic.
    """
    table = merge_layers(config_file, options, settings)
    replay = table.get("replay")
    if isinstance(replay, str):
        path = Path(replay).resolve()
        part = _recorded_part(path, table) if runfolder.is_run_folder(path) else _recorded_traffic_part(path, table)
        table |= part | {"replay": str(path)}
    elif isinstance(traffic := table.get("traffic"), Mapping) and traffic.get("recording"):
        option = next(iter(traffic["recording"]))
        raise UserError(f"--{option}: simulated traffic has no such choice; add --replay FILE of recorded traffic")
    return config_from_table(table)


def _recorded_traffic_part(path: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the traffic's table with the file's format and the network that it is driven on."""
    from harness.truth.recorded.formats import network_of, recognise  # noqa: PLC0415

    traffic = dict(asked.get("traffic", {}))
    recording = {"ego": "auto"} | dict(traffic.get("recording", {}))
    entry = recognise(path, recording.get("format"))
    traffic["recording"] = recording | {"format": entry.name}
    return {"traffic": traffic | {"net": network_of(entry, traffic.get("net"))}}


def _recorded_part(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return traffic, sensor and (unless asked otherwise) seed of the recording; refuse what contradicts them."""
    runfolder.read_manifest(folder, "--replay")
    recorded = config_from_table(runfolder.read_config_table(folder, "--replay")).as_table()
    part = {name: recorded[name] for name in ("traffic", "sensor")}
    for key, value in _leaves({name: asked[name] for name in part if name in asked}):
        if value != dict(_leaves(part)).get(key):
            raise UserError(
                f"{OPTION_OF_KEY.get(key, key)}: a replay takes traffic and sensor from the recording; leave it out"
            )
    return part | {"seed": asked.get("seed", recorded["seed"])}


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
