"""The available trackers, and how each is built by name."""

import inspect
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from functools import cache, partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from harness.common.error_text import first_problem, nearest, what_it_raised
from harness.common.errors import InputError
from harness.common.named import check_made, named, without_method
from harness.common.signals import told_to_end
from harness.common.streams import streams_and_depth_kept
from harness.trackers import program
from harness.trackers.protocol import AnyTracker, TrackerFactory, TrackerSetting
from mmpf.options.base import Settings, fields_of
from mmpf.registry import Entry, Registry, UnknownNameError

# Each tracker's factory, the class of its options, and one line about it.
_BUILT_IN = {
    "mmpf": (
        "mmpf:build_mixture_tracker", "mmpf:MixtureTrackerOptions",
        "Modified Mixture Particle Filter, the tracker of this project",
    ),
    "stonesoup-gnn": (
        "stonesoup.trackers:build_gnn", "stonesoup.options:StoneSoupOptions",
        "Stone Soup: Kalman filters, global nearest neighbour association",
    ),
    "stonesoup-jpda": (
        "stonesoup.trackers:build_jpda", "stonesoup.options:JpdaOptions",
        "Stone Soup: Kalman filters, joint probabilistic data association (EHM2)",
    ),
    "stonesoup-jpda-stitched": (
        "stonesoup.trackers:build_stitched_jpda", "stonesoup.options:StitchedJpdaOptions",
        "stonesoup-jpda; reappearing vehicles get their old identity back",
    ),
    "immortal-kalman": (
        "stonesoup.trackers:build_immortal", "stonesoup.options:ImmortalOptions",
        "Stone Soup: Kalman filters whose confirmed tracks never end within range, nearest neighbour association",
    ),
    "box-kalman": (
        "rivals.box_kalman:build_box_kalman", "rivals.box_kalman:BoxKalmanOptions",
        "Kalman filters of boxes matched by overlap, like AB3DMOT and SimpleTrack",
    ),
    "oc-sort": (
        "rivals.oc_sort:build_oc_sort", "rivals.oc_sort:OcSortOptions",
        "box-kalman's filters with the momentum, recovery and re-update of OC-SORT",
    ),
    "pmbm": (
        "rivals.pmbm.tracker:build_pmbm", "rivals.pmbm.tracker:PmbmOptions",
        "Poisson multi-Bernoulli mixture filter with an occlusion model",
    ),
    "lmb": (
        "rivals.lmb.labelled:build_lmb", "rivals.lmb.options:LmbOptions",
        "Labelled multi-Bernoulli filter of multisensor-lmb-filters-rs; needs Python 3.12",
    ),
    "oracle-kalman": (
        "oracle:build_oracle_kalman", "oracle:OracleOptions",
        "Kalman filters with the true association: a reference, not a tracker",
    ),
    "detections": (
        "detections:build_detections", "detections:DetectionsOptions",
        "the detections of each scan: a baseline without memory, not a tracker",
    ),
}  # fmt: skip
_EXTRAS = {"lmb": ("baselines", "multisensor-lmb-filters-rs and Python 3.12")}
_EXTRAS |= dict.fromkeys(("stonesoup", "immortal"), ("baselines", "Stone Soup"))
_ROOM = "harness.trackers"
trackers: Registry[TrackerFactory] = Registry(
    "tracker",
    _ROOM,
    {
        name: Entry(f"{_ROOM}.{place}", about, *_EXTRAS.get(name.partition("-")[0], ()))
        for name, (place, _, about) in _BUILT_IN.items()
    },
    "unknown; choose one of {known}, or package.module:factory for your own",
    without_method("step(scan)", "step_associated"),
)
_options: Registry[type[Settings]] = Registry(
    "class of options", entries={name: Entry(f"{_ROOM}.{place}") for name, (_, place, _) in _BUILT_IN.items()}
)


def available_trackers() -> dict[str, str]:
    """Return each built-in tracker's name and one line about it."""
    return {name: entry.about for name, entry in trackers.entries.items()}


def tracker_options(name: str) -> type[Settings]:
    """Return the class of a built-in tracker's options, whether or not what the tracker needs is installed."""
    return _options[name]


def build_tracker(
    maker: str | TrackerFactory, setting: TrackerSetting, options: Mapping[str, object], *, tuned: bool = True
) -> AnyTracker:
    """Build a fresh tracker for one episode.

    Args:
        maker: A name from ``available_trackers``, one that was registered with ``trackers`` or that an
            installed package declares as an entry point of ``harness.trackers``, or ``package.module:factory`` for a
            tracker of one's own, or ``exec:`` and the command of a program (``harness.trackers.program``); or the
            factory itself.
        options: The tracker's own options; they override its tuned ones.
        tuned: Whether the others are as they were tuned; else they are as in the tracker's code.

    Raises:
        InputError: The name is unknown, an extra is not installed, a dotted path leads nowhere, or an option is wrong.
    """
    if isinstance(maker, str):
        factory = factory_named(maker)
        options = _over(tuned_options(maker), options) if tuned else options
    else:
        factory = maker
    _check_signature(maker, factory)
    own = isinstance(maker, str) and maker in _BUILT_IN
    try:
        # What is recorded and scored is not in the hands of others.
        with streams_and_depth_kept():
            tracker = factory(setting if own else deepcopy(setting), options)
        check_made(trackers, "tracker", _name_of(maker), tracker)
    except ValidationError as error:
        raise InputError(_first_option_error(str(maker), error)) from None
    except (InputError, ValueError, TypeError, UnknownNameError):
        raise
    except BaseException as error:
        if own or isinstance(error, KeyboardInterrupt) or told_to_end():
            raise
        raise InputError(f"`tracker` {_name_of(maker)}: it can't be built ({what_it_raised(error)}); fix it") from error
    return tracker


def factory_named(name: str) -> TrackerFactory:
    """Return what builds the tracker of a name, see ``build_tracker``.

    Raises:
        InputError: There is none.
    """
    if name.startswith(program.PREFIX):
        return partial(program.ProgramTracker, name)
    return named(trackers, "tracker", name)


def _name_of(maker: str | TrackerFactory) -> str:
    return maker if isinstance(maker, str) else getattr(maker, "__name__", "factory")


def _over(base: Mapping[str, object], above: Mapping[str, object]) -> dict[str, object]:
    """Return the options of both, group by group; where both set one, it is as in ``above``."""
    merged = dict(base)
    for name, value in above.items():
        under = merged.get(name)
        merged[name] = _over(under, value) if isinstance(under, Mapping) and isinstance(value, Mapping) else value
    return merged


def _check_signature(maker: str | TrackerFactory, factory: TrackerFactory) -> None:
    """Refuse with an ``InputError`` a factory that can't be called as factories are."""
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


def _first_option_error(tracker: str, error: ValidationError) -> str:
    problem = first_problem(error)
    message = problem.message
    if problem.unknown and tracker in _BUILT_IN:
        known = [key for key, _ in fields_of(tracker_options(tracker))]
        message = f"there is none of that name{nearest(problem.key, known)}"
    return f"tracker option {problem.key!r} of {tracker}: {message}"


TUNED_FILE = Path(__file__).with_name("tuned.toml")


def tuned_options(tracker: str) -> dict[str, object]:
    """Return a tracker's tuned options; empty for one that was never tuned."""
    return dict(_tuned_tables().get(tracker, {}).get("options", {}))


@cache
def _tuned_tables() -> dict[str, Any]:
    return tomllib.loads(TUNED_FILE.read_text(encoding="utf-8"))
