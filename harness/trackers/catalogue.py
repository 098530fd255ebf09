"""Which trackers there are, and how one is built by name."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast

from pydantic import ValidationError

from harness.errors import UserError
from harness.trackers.protocol import Tracker, TrackerFactory, TrackerSetting, TruthAssociatedTracker, trackers
from harness.writing.problems import first_problem


@dataclass(frozen=True)
class _Entry:
    """Where a named tracker is registered.

    Attributes:
        module: Importing it registers the tracker; it is not imported before the tracker is asked for.
        description: One line for people.
        needs: What must be installed beyond the runtime dependencies: name and extra, empty if nothing.
    """

    module: str
    description: str
    needs: tuple[str, str] | None = None


_STONE_SOUP = ("Stone Soup", "baselines")
_STONE_SOUP_MODULE = "harness.trackers.stonesoup.trackers"
_CATALOGUE = {
    "mmpf": _Entry("harness.trackers.mmpf", "Modified Mixture Particle Filter, the tracker of this project"),
    "stonesoup-gnn": _Entry(
        _STONE_SOUP_MODULE, "Stone Soup: Kalman filters, global nearest neighbour association", _STONE_SOUP
    ),
    "stonesoup-jpda": _Entry(
        _STONE_SOUP_MODULE, "Stone Soup: Kalman filters, joint probabilistic data association (EHM2)", _STONE_SOUP
    ),
    "stonesoup-jpda-stitched": _Entry(
        _STONE_SOUP_MODULE, "stonesoup-jpda, and a re-appearing vehicle takes its old identity", _STONE_SOUP
    ),
    "stonesoup-particle": _Entry(
        _STONE_SOUP_MODULE, "Stone Soup: a particle filter per track, global nearest neighbour association", _STONE_SOUP
    ),
    "oracle-kalman": _Entry(
        "harness.trackers.oracle", "Kalman filters told the true association: a bound, not a tracker"
    ),
}


def available_trackers() -> dict[str, str]:
    """Return each built-in tracker's name and one line about it."""
    return {name: entry.description for name, entry in _CATALOGUE.items()}


def build_tracker(
    name: str, setting: TrackerSetting, options: Mapping[str, object]
) -> Tracker | TruthAssociatedTracker:
    """Build a fresh tracker for one episode.

    Args:
        name: A name from ``available_trackers``, one that was registered with ``protocol.trackers``, or
            ``package.module:factory`` for a tracker of one's own.
        setting: What the tracker may know.
        options: The tracker's own options; they override its tuned ones.

    Raises:
        UserError: The name is unknown, an extra is not installed, a dotted path leads nowhere, or an option is wrong.
    """
    factory = _import_factory(name) if ":" in name else _registered_factory(name)
    try:
        return factory(setting, {**tuned_options(name), **options})
    except ValidationError as error:
        raise UserError(_first_option_error(name, error)) from None


def _registered_factory(name: str) -> TrackerFactory:
    entry = _CATALOGUE.get(name)
    if entry is not None:
        _import_entry(name, entry)
    if name not in set(trackers):
        known = ", ".join(sorted({*_CATALOGUE, *trackers}))
        raise UserError(f"--tracker {name}: unknown; choose one of {known}, or package.module:factory for your own")
    return trackers[name]


def _import_entry(name: str, entry: _Entry) -> None:
    try:
        importlib.import_module(entry.module)
    except ModuleNotFoundError as error:
        if entry.needs is None or (error.name or "").split(".")[0] in {"harness", "mmpf"}:
            raise
        package, extra = entry.needs
        raise UserError(
            f"--tracker {name} needs {package}, which is not installed: pip install 'mmpf-harness[{extra}]'"
        ) from None


def _import_factory(path: str) -> TrackerFactory:
    module_name, _, attribute = path.partition(":")
    try:
        module = importlib.import_module(module_name)
    except (ImportError, ValueError) as error:
        raise UserError(
            f"--tracker {path}: can't import {module_name!r} ({error}); is it on PYTHONPATH or installed?"
        ) from None
    factory = getattr(module, attribute, None)
    if not callable(factory):
        raise UserError(f"--tracker {path}: {module_name} has no callable {attribute!r}")
    return cast(TrackerFactory, factory)


def _first_option_error(tracker: str, error: ValidationError) -> str:
    problem = first_problem(error)
    return f"tracker option {problem.key!r} of {tracker}: {problem.message}"


TUNED_FILE = Path(__file__).with_name("tuned.toml")


def tuned_options(tracker: str) -> dict[str, object]:
    """Return a tracker's tuned options; empty for one that was never tuned."""
    return dict(_tuned_tables().get(tracker, {}))


@cache
def _tuned_tables() -> dict[str, dict[str, object]]:
    if not TUNED_FILE.exists():
        return {}
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    return {name: table["options"] for name, table in tables.items()}
