"""All keys of ``config.toml`` with defaults, units and meanings, collected from their definitions."""

import functools
import inspect
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from rich.console import Console, Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from harness.common.errors import InputError
from harness.config.model import DEFAULT_TRACKER, RunConfig, SensorConfig, TrackerConfig
from harness.running.resolve import with_usual_traffic
from harness.sensor.profiles import sensor_profiles, sensor_settings
from harness.trackers.catalogue import available_trackers, tracker_options, trackers, tuned_options
from harness.truth.network.network import available_networks
from harness.truth.recorded.outside import recording_formats
from mmpf.motion.protocol import motion_models
from mmpf.options.base import fields_of, unit_of
from mmpf.registry import Registry, UnknownNameError

# Options that ``config.toml`` has beside the tracker's name.
NAMED_OPTIONS = tuple(TrackerConfig(name="any").model_dump(exclude={"name", "options"}))
WIDEST, WIDEST_UNIT = 130, 12


@dataclass(frozen=True)
class Setting:
    """One setting, or one named thing that a setting takes; ``default`` is None for that.

    ``key`` is the dotted path as in ``config.toml``, with ``=NAME`` behind it for a named thing. ``kind`` is ``run``,
    ``sensor PROFILE`` or ``tracker NAME`` for settings; ``network``, ``format of recorded traffic``, ``sensor
    profile``, ``tracker`` or ``motion model`` for named things.
    """

    key: str
    default: object
    unit: str
    meaning: str
    kind: str


def all_settings(word: str = "") -> list[Setting]:
    """Return what can be set, group by group, as far as it has a word in its key or kind."""
    found = [row for row in _everything() if word.lower() in row.key.lower() or word.lower() in row.kind.lower()]
    if not found:
        raise InputError(f"`word` {word!r}: no setting has that in its name; leave it out to see all of them")
    return found


def _everything() -> Iterator[Setting]:
    run = list(_rows("", with_usual_traffic(RunConfig()), "run"))
    yield from (row for row in run if not row.key.startswith(("sensor.", "tracker.")))
    for network in available_networks():
        yield Setting(f"traffic.net={network.name}", None, "", network.description, "network")
    yield from (row for row in run if row.key.startswith("sensor."))
    yield from _named("traffic.recording.format", recording_formats.names(), recording_formats, recording_formats.kind)
    yield from _named("sensor.profile", sensor_profiles, sensor_profiles, "sensor profile")
    yield from _sensors()
    yield from (row for row in run if row.key.startswith("tracker.") and row.key != "tracker.options")
    for name, description in available_trackers().items():
        yield Setting(f"tracker.name={name}", None, "", description, "tracker")
    yield from _named("tracker.name", sorted({*trackers} - {*available_trackers()}), trackers, "tracker")
    yield from _named("tracker.model", motion_models, motion_models, motion_models.kind)
    for name in available_trackers():
        yield from _tracker(name)


def _tracker(name: str) -> Iterator[Setting]:
    """Yield a tracker's options as they are tuned; those that have a place of their own in ``config.toml``, there."""
    for row in _rows("", tracker_options(name).model_validate(tuned_options(name)), f"tracker {name}"):
        if row.key not in NAMED_OPTIONS:
            yield replace(row, key=f"tracker.options.{row.key}")
        elif name != DEFAULT_TRACKER:
            yield replace(row, key=f"tracker.{row.key}")


def _sensors() -> Iterator[Setting]:
    """Yield the settings of the usual profile, and of the others what is different there."""
    usual = SensorConfig().profile
    known = list(_rows("sensor.", sensor_profiles[usual](), f"sensor {usual}"))
    yield from known
    for profile in sorted(set(sensor_profiles) - {usual}):
        try:
            settings = sensor_settings(profile, {})
        except InputError:
            continue  # the list of profiles says why
        rows = _rows("sensor.", settings, f"sensor {profile}")
        yield from (row for row, other in zip(rows, known, strict=True) if row.default != other.default)


def _rows(prefix: str, settings: BaseModel, kind: str) -> Iterator[Setting]:
    for key, field in fields_of(type(settings)):
        *groups, name = key.split(".")
        group = functools.reduce(getattr, groups, settings)
        default = field.get_default() if group is None else getattr(group, name)
        if default is PydanticUndefined:
            default = None
        if isinstance(default, float) and math.isinf(default):
            default = str(default)  # as TOML writes it; JSON has none
        meaning = " ".join((field.description or "").replace("``", "").split())
        yield Setting(prefix + key, default, unit_of(key, field), meaning, kind)


def _named(key: str, names: Iterable[str], registry: Registry[Any], kind: str) -> Iterator[Setting]:
    """Yield the named things that a setting takes, each with what it says of itself."""
    yield from (Setting(f"{key}={name}", None, "", _summary_of(registry, name), kind) for name in names)


def _summary_of(registry: Registry[Any], name: str) -> str:
    """Return what an entry says of itself; of a plug-in that can't be imported, why."""
    if (entry := registry.entries.get(name)) is not None and entry.about:
        return entry.about
    try:
        return _summary(registry[name])
    except UnknownNameError as error:
        return str(error)


def _summary(thing: object) -> str:
    if isinstance(thing, functools.partial):
        given = [thing.keywords["name"]] if "name" in thing.keywords else thing.args[:1]
        return ": ".join([_summary(thing.func).rstrip("."), *map(str, given)]) + "."
    summary = (inspect.getdoc(thing) or "").partition("\n\n")[0].removeprefix("Return ")
    return summary[:1].upper() + summary[1:]


def print_settings(rows: Sequence[Setting]) -> None:
    """Print settings on stdout: for each group its path and kind, and below it a line for each setting."""
    console = Console(highlight=False)
    console.width = min(console.width, WIDEST) if console.is_terminal else WIDEST
    cells = [(_name(row.key), default_text(row), row.unit) for row in rows]
    name, default, unit = (max(len(cell) for cell in column) for column in zip(*cells, strict=True))
    for (kind, group), members in groupby(rows, key=lambda row: (row.kind, _group(row.key))):
        table = Table.grid(padding=(0, 2, 0, 0))
        for width in (name, default, min(unit, WIDEST_UNIT), None):
            table.add_column(width=width, overflow="fold")
        for row in members:
            table.add_row(_name(row.key), default_text(row), row.unit, row.meaning)
        heading = Text.assemble((group or "at the top", "bold"), f"  {kind}")
        console.print(Group(heading, Padding(table, (0, 0, 1, 2), expand=False)))


def _group(key: str) -> str:
    """Return what stands before the setting's own name, or the key that a named thing is for."""
    before, equals, _ = key.partition("=")
    return before if equals else key.rpartition(".")[0]


def _name(key: str) -> str:
    return key[len(_group(key)) :].lstrip(".=")


def default_text(row: Setting) -> str:
    """Return a default as people read it; ``-`` for none."""
    if row.default is None:
        return "" if "=" in row.key else "-"
    if isinstance(row.default, bool):
        return str(row.default).lower()
    return f"{row.default:.6g}" if isinstance(row.default, float) else str(row.default)
