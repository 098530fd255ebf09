"""Completes a run's configuration from what it names: a network, a recording or an earlier run."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from harness.common.errors import InputError
from harness.common.files import write_text
from harness.common.untrusted_files import checked_path, read_toml
from harness.config.layers import check_modules, config_from_table, leaves, merged, parameter_of
from harness.config.model import DEFAULT_TRACKER, RunConfig, SensorConfig, TrackerConfig, brings_its_own_demand
from harness.decisions.drivers.protocol import drivers
from harness.sensor.profiles import has_all_figures, is_built_in, sensor_profiles, sensor_settings
from harness.storage import run_folder as runfolder
from harness.trackers.catalogue import available_trackers, tracker_options, trackers
from harness.truth.network.demand import DEFAULT_DENSITY
from harness.truth.network.network import default_demand
from harness.truth.recorded.formats import example, network_of, recognise
from harness.truth.recorded.outside import recording_formats
from mmpf.motion.protocol import motion_models
from mmpf.registry import Registry

own_metrics: Registry[object] = Registry(
    "metric", "harness.metrics", unknown="{name!r} is no metric; give module:function"
)
"""Metrics of the user's, which are registered where their module is imported."""


def resolve_run_config(
    config_file: Path | None = None, options: Mapping[str, object] | None = None, settings: Sequence[str] = ()
) -> RunConfig:
    """Return the checked configuration of a run.

    Args:
        options: The run's options by name (``net``, ``duration``, ...); None where not given.

    Raises:
        InputError: A file can't be read, a key is unknown or a value is out of bounds; or a replay is asked for
            traffic, a sensor or a folder that the recording does not have; or the file is no recorded traffic.
    """
    table = merged(config_file, options or {}, settings)
    for name in ("traffic", "sensor", "tracker"):
        if not isinstance(table.get(name, {}), dict):
            raise InputError(f"`settings`: {name} is a table of settings, not a value; for example {name}.KEY=VALUE")
    if not isinstance(table.get("traffic", {}).get("recording", {}), dict):
        raise InputError("`settings`: traffic.recording is a table of settings; for example traffic.recording.ego=auto")
    if config_file is not None:
        check_modules(read_toml(config_file, "config"), merged(None, options or {}, settings), config_file)
    replay = table.get("replay")
    if isinstance(replay, str):
        path = Path(os.path.realpath(example(checked_path(Path(replay), "replay"))))
        part = _recorded_part(path, table) if runfolder.is_run_folder(path) else _recorded_traffic_part(path, table)
        table |= part | {"replay": str(path)}
    elif isinstance(traffic := table.get("traffic"), Mapping) and traffic.get("recording"):
        parameter = next(iter(traffic["recording"]))
        raise InputError(f"`{parameter}`: simulated traffic has no such choice; add `replay`, recorded traffic")
    config = config_from_table(table)
    _check_takes_options(config.tracker)
    return with_usual_traffic(config)


def _check_takes_options(tracker: TrackerConfig) -> None:
    """Refuse an option of the command line that only other trackers of this program take."""
    built_in = available_trackers()
    if tracker.name == DEFAULT_TRACKER or tracker.name not in built_in:
        return
    named = tracker.all_options().keys() - tracker.options.keys()
    for option in sorted(named - tracker_options(tracker.name).model_fields.keys()):
        others = ", ".join(name for name in built_in if option in tracker_options(name).model_fields)
        raise InputError(f"`{option}`: {tracker.name} takes none; these trackers do: {others}")


def with_usual_traffic(config: RunConfig) -> RunConfig:
    """Return a configuration with its network's default demand or density where it sets neither."""
    traffic = config.traffic
    asked = traffic.demand is not None or traffic.density is not None or traffic.recording is not None
    if asked or brings_its_own_demand(traffic.net):
        return config
    demand = default_demand(traffic.net)
    usual = {"demand": demand, "density": DEFAULT_DENSITY if demand is None else None}
    return config.model_copy(update={"traffic": traffic.model_copy(update=usual)})


def _recorded_traffic_part(path: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return traffic with the file's format and network, and the sensor of a recording with its own detections."""
    traffic, sensor = dict(asked.get("traffic", {})), dict(asked.get("sensor", {}))
    asked_for = dict(traffic.get("recording", {}))
    entry = recognise(path, asked_for.get("format"))
    recording = {"ego": entry.usual_ego} | asked_for | {"format": entry.name}
    part = {"traffic": traffic | {"recording": recording, "net": network_of(entry, traffic.get("net"))}}
    if entry.sensor is None:
        return part
    own = f"a {entry.name} recording"
    if (ego := recording["ego"]) not in ("auto", "each"):
        raise InputError(f"`ego` {ego}: {own} is seen from its own car; leave `ego` out")
    if (profile := sensor.get("profile")) not in (None, entry.sensor):
        raise InputError(f"`sensor` {profile}: {own} brings its own detections; leave `sensor` out")
    return part | {"sensor": sensor | {"profile": entry.sensor}}


def _recorded_part(folder: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return traffic, sensor and (unless asked otherwise) seed and alterations; refuse what contradicts them."""
    runfolder.read_manifest(folder, "replay", ended=False)
    config = config_from_table(runfolder.read_config_table(folder, "replay"))
    if asked.get("sensor", {}).get("profile") != config.sensor.profile:
        check_sensor_of_folder(config.sensor, folder, "replay")
    recorded = config.as_table()
    part = {name: recorded[name] for name in ("traffic", "sensor")}
    for key, value in leaves({name: asked[name] for name in part if name in asked}):
        if value != dict(leaves(part)).get(key):
            parameter = parameter_of(key) or key
            raise InputError(f"`{parameter}`: a replay takes traffic and sensor from the recording; leave it out")
    if not asked.get("altered"):
        part |= {"altered": recorded.get("altered", {})}
    elif (now := config_from_table({"altered": asked["altered"]}).altered) != config.altered and (
        now.hide_s and config.altered.hide_s
    ):
        raise InputError(f"`hide`: vehicles are hidden on purpose in {folder} already; leave `hide` out")
    return part | {"seed": asked.get("seed", recorded["seed"])}


def check_sensor_of_folder(sensor: SensorConfig, folder: Path, parameter: str) -> None:
    """Refuse a run's folder whose sensor would have to be imported."""
    if not is_built_in(sensor.profile) and not has_all_figures(sensor.profile, sensor.overrides):
        raise InputError(
            f"`{parameter}`: the sensor of {folder} is {sensor.profile}, whose figures are not all in its config.toml, "
            f"and importing it would run it; if you trust it, make the run again with `sensor` {sensor.profile}"
        )


def written_table(config: RunConfig) -> dict[str, Any]:
    """Return what ``write_config`` writes: a sensor from outside in full, so that readers need no code of others."""
    table = config.as_table()
    if not is_built_in(config.sensor.profile):
        figures = sensor_settings(config.sensor.profile, config.sensor.overrides)
        table["sensor"] = {"profile": config.sensor.profile} | figures.model_dump(exclude_none=True)
    return table


def write_config(config: RunConfig, path: Path) -> None:
    """Write a configuration so that ``config`` reads the same one back."""
    write_text(path, tomli_w.dumps(written_table(config)))


def external_code(config: RunConfig, *, but_tracker: bool) -> str:
    """Return the names in a run's configuration whose code is not part of this program, for messages.

    Args:
        but_tracker: Whether the tracker's name says nothing, as where the caller hands over its factory.
    """
    recording = config.traffic.recording
    named = (
        (trackers, None if but_tracker else config.tracker.name),
        (motion_models, config.tracker.model),
        (sensor_profiles, config.sensor.profile),
        (drivers, config.decisions.driver),
        (recording_formats, recording.format if recording is not None else None),
        (own_metrics, config.metric),
    )
    return ", ".join(name for registry, name in named if name and registry.is_outside(name))


def import_metrics(config: RunConfig) -> None:
    """Import the module of the user's metric, or raise an ``InputError`` that says why it can't be had."""
    if config.metric is not None and (problem := own_metrics.problem(config.metric)):
        raise InputError(f"`metric`{problem}")
