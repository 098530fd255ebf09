"""The configuration of a run that may be a replay: traffic and sensor then come from the recording."""

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
        config_file: As in ``harness.configfile.resolve_config``.
        options: Likewise.
        settings: Likewise.

    Raises:
        UserError: As there; or a replay is asked for traffic, a sensor or a folder that the recording does not have.
    """
    table = merge_layers(config_file, options, settings)
    replay = table.get("replay")
    if isinstance(replay, str):
        folder = Path(replay).resolve()
        table |= _recorded_part(folder, table) | {"replay": str(folder)}
    return config_from_table(table)


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
