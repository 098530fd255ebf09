"""Which trackers there are, and how one is built by name."""

from __future__ import annotations

import difflib
import importlib
import inspect
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast

from pydantic import ValidationError

from harness.common.error_text import first_problem, what_it_raised
from harness.common.errors import InputError
from harness.trackers.protocol import AnyTracker, TrackerFactory, TrackerSetting, trackers
from mmpf.options.base import Settings, fields_of
from mmpf.registry import UnknownNameError


@dataclass(frozen=True)
class _Entry:
    """Where a named tracker is registered; nothing of it is imported before it is asked for."""

    module: str
    description: str
    options: str  # module:class
    needs: tuple[str, str] | None = None  # what must be installed beyond the runtime dependencies: name and extra


def _stone_soup(description: str, options: str) -> _Entry:
    room = "harness.trackers.stonesoup"
    return _Entry(f"{room}.trackers", description, f"{room}.options:{options}", ("Stone Soup", "baselines"))


_CATALOGUE = {
    "mmpf": _Entry(
        "harness.trackers.mmpf",
        "Modified Mixture Particle Filter, the tracker of this project",
        "harness.trackers.mmpf:MixtureTrackerOptions",
    ),
    "stonesoup-gnn": _stone_soup(
        "Stone Soup: Kalman filters, global nearest neighbour association", "StoneSoupOptions"
    ),
    "stonesoup-jpda": _stone_soup(
        "Stone Soup: Kalman filters, joint probabilistic data association (EHM2)", "JpdaOptions"
    ),
    "stonesoup-jpda-stitched": _stone_soup(
        "stonesoup-jpda, and a re-appearing vehicle takes its old identity", "StitchedJpdaOptions"
    ),
    "immortal-kalman": _stone_soup(
        "Stone Soup: Kalman filters whose confirmed tracks never end within range, nearest neighbour association",
        "ImmortalOptions",
    ),
    "box-kalman": _Entry(
        "harness.trackers.rivals.box_kalman",
        "Kalman filters of boxes matched by their overlap, as AB3DMOT and SimpleTrack do it",
        "harness.trackers.rivals.box_kalman:BoxKalmanOptions",
    ),
    "oc-sort": _Entry(
        "harness.trackers.rivals.oc_sort",
        "box-kalman's filters with the momentum, recovery and re-update of OC-SORT",
        "harness.trackers.rivals.oc_sort:OcSortOptions",
    ),
    "imm-gnn": _Entry(
        "harness.trackers.rivals.imm_gnn",
        "interacting models (constant velocity; constant turn rate and acceleration), global nearest neighbour",
        "harness.trackers.rivals.imm_gnn:ImmGnnOptions",
    ),
    "pmbm": _Entry(
        "harness.trackers.rivals.pmbm.tracker",
        "Poisson multi-Bernoulli mixture filter, aware of shadows",
        "harness.trackers.rivals.pmbm.tracker:PmbmOptions",
    ),
    "oracle-kalman": _Entry(
        "harness.trackers.oracle",
        "Kalman filters told the true association: a reference, not a tracker",
        "harness.trackers.oracle:OracleOptions",
    ),
    "detections": _Entry(
        "harness.trackers.detections",
        "each scan's detections and nothing else: a baseline without memory, not a tracker",
        "harness.trackers.detections:DetectionsOptions",
    ),
}


def available_trackers() -> dict[str, str]:
    """Return each built-in tracker's name and one line about it."""
    return {name: entry.description for name, entry in _CATALOGUE.items()}


def tracker_options(name: str) -> type[Settings]:
    """Return the class of a built-in tracker's options, whether or not what the tracker needs is installed."""
    module, _, options = _CATALOGUE[name].options.partition(":")
    return cast(type[Settings], getattr(importlib.import_module(module), options))


def build_tracker(
    maker: str | TrackerFactory, setting: TrackerSetting, options: Mapping[str, object], *, tuned: bool = True
) -> AnyTracker:
    """Build a fresh tracker for one episode.

    Args:
        maker: A name from ``available_trackers``, one that was registered with ``protocol.trackers`` or that an
            installed package declares as an entry point of ``harness.trackers``, or ``package.module:factory`` for a
            tracker of one's own; or the factory itself.
        setting: What the tracker may know.
        options: The tracker's own options; they override its tuned ones.
        tuned: Whether the others are as they were tuned; else they are as in the tracker's code.

    Raises:
        InputError: The name is unknown, an extra is not installed, a dotted path leads nowhere, or an option is wrong.
    """
    if isinstance(maker, str):
        factory = _factory(maker)
        options = _over(tuned_options(maker), options) if tuned else options
    else:
        factory = maker
    _check_signature(maker, factory)
    try:
        tracker = factory(setting, options)
    except ValidationError as error:
        raise InputError(_first_option_error(str(maker), error)) from None
    except (InputError, ValueError, TypeError, UnknownNameError):
        raise
    except Exception as error:
        if isinstance(maker, str) and maker in _CATALOGUE:
            raise
        raise InputError(
            f"`tracker` {_name_of(maker)}: it can't be built ({what_it_raised(error)}); mend it"
        ) from error
    if not callable(getattr(tracker, "step", getattr(tracker, "step_associated", None))):
        raise InputError(
            f"`tracker` {_name_of(maker)}: it returned {type(tracker).__name__}, which has no method step(scan)"
        )
    return tracker


def _name_of(maker: str | TrackerFactory) -> str:
    return maker if isinstance(maker, str) else getattr(maker, "__name__", "factory")


def _over(base: Mapping[str, object], above: Mapping[str, object]) -> dict[str, object]:
    """Return the options of both, group by group; where both set one, it is as in ``above``."""
    merged = dict(base)
    for name, value in above.items():
        under = merged.get(name)
        merged[name] = _over(under, value) if isinstance(under, Mapping) and isinstance(value, Mapping) else value
    return merged


def _factory(name: str) -> TrackerFactory:
    entry = _CATALOGUE.get(name)
    if entry is not None:
        _import_entry(name, entry)
    elif ":" not in name and name not in set(trackers):
        known = ", ".join(sorted({*_CATALOGUE, *trackers}))
        raise InputError(f"`tracker` {name}: unknown; choose one of {known}, or package.module:factory for your own")
    try:
        return trackers[name]
    except UnknownNameError as error:
        raise InputError(f"`tracker` {name}: {error}") from None


def _check_signature(maker: str | TrackerFactory, factory: TrackerFactory) -> None:
    """Refuse a factory that can't be called as factories are.

    Raises:
        InputError: It takes other arguments.
    """
    try:
        signature = inspect.signature(factory)
    except (ValueError, TypeError):
        return
    try:
        signature.bind(object(), {})
    except TypeError:
        raise InputError(
            f"`tracker` {maker}: a factory is called with two arguments, setting (what the tracker may know) and "
            f"options (a mapping); this one takes {signature}"
        ) from None


def _import_entry(name: str, entry: _Entry) -> None:
    try:
        importlib.import_module(entry.module)
    except ModuleNotFoundError as error:
        if entry.needs is None or (error.name or "").split(".")[0] in {"harness", "mmpf"}:
            raise
        package, extra = entry.needs
        raise InputError(
            f"`tracker` {name} needs {package}, which is not installed: pip install '.[{extra}]'"
        ) from None


def _first_option_error(tracker: str, error: ValidationError) -> str:
    problem = first_problem(error)
    message = problem.message
    if problem.unknown and tracker in _CATALOGUE:
        message = f"there is none of that name{_nearest(problem.key, tracker)}"
    return f"tracker option {problem.key!r} of {tracker}: {message}"


def _nearest(option: str, tracker: str) -> str:
    known = [key for key, _ in fields_of(tracker_options(tracker))]
    of_that_name = [key for key in known if key.split(".")[-1] == option.rsplit(".", maxsplit=1)[-1]]
    near = of_that_name or difflib.get_close_matches(option, known, n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(near)}?" if near else f"; known are {', '.join(known)}"


TUNED_FILE = Path(__file__).with_name("tuned.toml")


def tuned_options(tracker: str) -> dict[str, object]:
    """Return a tracker's tuned options; empty for one that was never tuned."""
    return dict(_tuned_tables().get(tracker, {}))


@cache
def _tuned_tables() -> dict[str, dict[str, object]]:
    if not TUNED_FILE.exists():
        return {}
    tables = tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
    return {name: table.get("options", {}) for name, table in tables.items()}
