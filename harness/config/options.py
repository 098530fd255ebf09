"""The options of a run, each declared once for the configuration, the command line and Python.

A table of options is a ``TypedDict`` whose entries carry an ``Option``. The first of an entry's types is what the
command line reads; the others are what Python may give as well.
"""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from numbers import Integral, Real
from pathlib import Path, PurePath
from sys import float_info
from types import NoneType
from typing import Annotated, Any, TypedDict, cast, get_args, get_origin, get_type_hints

import tomli_w

from harness.common.error_text import shown
from harness.common.errors import InputError
from harness.common.untrusted_files import checked_path
from harness.config.lists import MOST_SEED

TRAFFIC, TRACKING, RESULT = "Traffic and sensor", "Tracker", "Configuration and result"
EXECUTION = "How it is run"
DEEPEST = 20
"""So many dots a setting's key has at most."""


@dataclass(frozen=True)
class Option:
    """What is said of an option beside its name and type.

    Attributes:
        help: The line of ``--help``.
        key: The configuration's key that it sets; None of an option that does not decide a run's results.
        panel: Heading of ``--help`` under which it stands.
        default: Value where it is not given; ``...`` if it must be.
        flag: How it is typed, where that is not its name with dashes.
        metavar: What stands for its value in ``--help``.
        least: Smallest value; ``most`` is the largest.
        is_argument: Whether its value is typed without its name.
        alone: Value where its name is typed without one; None if it needs one.
    """

    help: str
    key: str | None = None
    panel: str | None = None
    default: Any = None
    flag: str | None = None
    metavar: str | None = None
    least: float | None = None
    most: float | None = None
    is_argument: bool = False
    alone: str | None = None


_traffic, _tracking, _result = (partial(Option, panel=panel) for panel in (TRAFFIC, TRACKING, RESULT))
execution = partial(Option, panel=EXECUTION)
"""Declares an option of how things are run."""

# Options that several commands have.
Net = Annotated[
    str | Path | None,
    _traffic("Network by name, or your own: a folder or .sumocfg file. (default: us101)", "traffic.net"),
]
Density = Annotated[
    float | None, _traffic("Vehicles per km and main lane, 5 to 65; replaces --demand.", "traffic.density")
]
Demand = Annotated[
    str | None, _traffic("Named demand of the network; see 'nets'. (default: us101-0805 on us101)", "traffic.demand")
]
BrokenDown = Annotated[
    int | None,
    _traffic(
        "Number of broken-down vehicles in the main lanes; other vehicles steer around them. (default: 0)",
        "traffic.broken_down",
        metavar="N",
    ),
]
Hide = Annotated[
    str | list[float] | None,
    _traffic(
        "Withhold the detections of moving vehicles for these numbers of seconds, each after 2 s in view; trackers do "
        "not know. (default: none)",
        "altered.hide_s",
        metavar="1,2,3,5",
    ),
]
Sensor = Annotated[
    str | None,
    _traffic(
        "Profile: lidar, radar, camera, ..., or module:profile; see 'settings'. (default: lidar)", "sensor.profile"
    ),
]
Settings = Annotated[
    list[str] | Mapping[str, object] | None,
    _result("Set any setting by its key in config.toml; repeatable.", flag="--set", metavar="KEY=VALUE"),
]
Seed = Annotated[int, Option("Root seed of all random numbers.", default=0, least=0, most=MOST_SEED)]
Cache = Annotated[Path | None, Option("Cache folder of recorded traffic. (default: one in results/cache/traffic)")]
Resume = Annotated[bool, execution("Reuse finished runs in --out; compute the missing ones.", default=False)]
RetryFailed = Annotated[bool, execution("Like --resume, and repeat failed runs.", default=False)]
Workers = Annotated[int | None, execution("Worker processes. (default: one per core)", least=1)]
OneWorker = Annotated[int, Option("Number of worker processes.", default=1, least=1)]
RecordedFields = Annotated[
    Path | None,
    Option("Folder of the recorded fields, to repeat the measurement. (default: the network's measured_file)"),
]
TimeoutPerRun = Annotated[
    float | None, execution("Stop and fail a run after this many seconds. (default: never)", least=0.1)
]
Json = Annotated[bool, Option("Print only the result, as JSON, on stdout.", default=False)]
Quiet = Annotated[bool, Option("Print no progress bar and no tables.", default=False)]


class RunOptions(TypedDict, total=False):
    """The keywords of ``harness.run``."""

    net: Net
    density: Density
    demand: Demand
    broken_down: BrokenDown
    duration: Annotated[
        float | None, _traffic("Scored time in seconds, not counting the warm-up. (default: 60)", "traffic.duration_s")
    ]
    sensor: Sensor
    replay: Annotated[
        Path | str | None,
        _traffic(
            "A run folder, to reuse its truth and detections; or a file of recorded traffic: CommonRoad "
            "XML, NGSIM CSV or text, highD folder, SUMO FCD, KITTI tracking with its detections; "
            "or pandaset, which comes with the harness. SUMO is not needed.",
            "replay",
        ),
    ]
    format: Annotated[
        str | None,
        _traffic(
            "Format of recorded traffic: commonroad, ngsim, ngsim-text, highd, fcd, pandaset, scenarionet, gpudrive, "
            "autoware, kitti-tracking, av2, or your own reader, module:function. (default: detected from the content; "
            "kitti-tracking and av2 must be named)",
            "traffic.recording.format",
        ),
    ]
    ego: Annotated[
        str | None,
        _traffic(
            "Recorded vehicle that carries the sensor: its ID, auto, each (every vehicle in turn) or each:N. (default: "
            "auto)",
            "traffic.recording.ego",
        ),
    ]
    hide: Hide
    gui: Annotated[
        bool,
        _traffic(
            "Show the traffic in sumo-gui during the run; results do not change. Close the window to stop. "
            "(extra: networks)",
            default=False,
        ),
    ]
    tracker: Annotated[
        str | Callable[..., Any] | None,
        _tracking("pmbm, oc-sort, ..., module:factory or exec:COMMAND. (default: mmpf)", "tracker.name"),
    ]
    model: Annotated[
        str | None,
        _tracking("Motion model of mmpf: gmm, cvm, ..., or module:Class. (default: residual)", "tracker.model"),
    ]
    update: Annotated[
        str | None, _tracking("Update rule of mmpf: joint or max_likelihood. (default: joint)", "tracker.update")
    ]
    particles: Annotated[int | None, _tracking("Particles per vehicle. (default: 1000)", "tracker.particles")]
    model_file: Annotated[
        str | Path | None,
        _tracking(
            "Your own model file from 'train' (npz) for the chosen --model: residual, gmm, ...", "tracker.model_file"
        ),
    ]
    driver: Annotated[
        str | None,
        _tracking(
            "Driver model that scores driving decisions on tracks against those on the truth: hdm, idm, mobil, or "
            "module:factory. (default: hdm)",
            "decisions.driver",
        ),
    ]
    seed: Annotated[
        int | None,
        _result("Root seed of all random numbers: the same seed gives the same results. (default: 0)", "seed"),
    ]
    config: Annotated[Path | str | None, _result("TOML file of settings, e.g. an earlier run's config.toml.")]
    settings: Settings
    out: Annotated[
        Path | str | None,
        _result(
            "Run folder to write. (default: results/NET-TRACKER-MODEL-TRAFFIC-SEED, with -2, -3, ... if it exists)"
        ),
    ]
    force: Annotated[bool, _result("Replace an earlier run in --out.", default=False)]
    resume: Annotated[
        bool, _result("Keep the finished run in --out if its settings, code and files are the same.", default=False)
    ]
    video: Annotated[Path | str | None, _result("Write a top-view video to this MP4 file. (extra: video)")]


@dataclass(frozen=True)
class Declared:
    """One entry of a table of options: the types that a value may have, None left out, the first the command line's."""

    types: tuple[Any, ...]
    option: Option


@cache
def options_of(table: type) -> dict[str, Declared]:
    """Return the entries of a table of options by name, in the table's order."""
    entries = {}
    for name, hint in get_type_hints(table, include_extras=True).items():
        kind, option = get_args(hint)
        union = get_args(kind) if get_origin(kind) not in _KINDS else (kind,)
        entries[name] = Declared(tuple(one for one in union or (kind,) if one is not NoneType), option)
    return entries


@cache
def keys_of_options() -> dict[str, str]:
    """Return the configuration's key that each of a run's options sets, by the option's name."""
    options = {name: entry.option for name, entry in options_of(RunOptions).items()}
    return {name: option.key for name, option in options.items() if option.key is not None}


_KINDS: dict[Any, tuple[Any, str]] = {
    str: (str, "a text"),
    Path: (PurePath, "a path"),
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    bool: (bool, "True or False"),
    range: (range, "a range"),
    list: ((list, tuple), "a list"),
    Sequence: (Sequence, "a list"),
    Mapping: (Mapping, "a dictionary"),
    Callable: (Callable, "a function"),
}


def checked(table: type, options: Mapping[str, object], call: str) -> dict[str, Any]:
    """Return options as the rest of the package takes them: plain Python values, paths as the table has them.

    Args:
        options: Values by name; None where not given.
        call: What was called, for the message.

    Raises:
        InputError: There is no such option, or a value has the wrong type or is out of range.
    """
    entries = options_of(table)
    for name in options:
        if name not in entries:
            near = difflib.get_close_matches(name, entries, n=1)
            hint = f"did you mean `{near[0]}`?" if near else f"there are {', '.join(entries)}"
            raise InputError(f"`{name}`: {call} has no such parameter; {hint}")
    given = {name: value for name, value in options.items() if value is not None}
    return {name: entry.option.default for name, entry in entries.items()} | {
        name: _checked_value(name, value, entries[name]) for name, value in given.items()
    }


def _checked_value(name: str, value: object, entry: Declared) -> object:
    # Arrays and numbers of NumPy become lists and numbers of Python, and whatever is a text a plain one.
    plain = str.__str__(value) if isinstance(value, str) else value.tolist() if hasattr(value, "tolist") else value
    kinds = [_KINDS[get_origin(one) or one] for one in entry.types]
    if not any(_is_a(plain, kind) for kind, _ in kinds):
        words = " or ".join(dict.fromkeys(word for _, word in kinds))
        raise InputError(f"`{name}`: give {words}, not {shown(value)}")
    least, most = entry.option.least, entry.option.most
    low, high = -float_info.max if least is None else least, float_info.max if most is None else most
    if isinstance(plain, int | float) and not low <= plain <= high:
        bounds = "a number" if least is None else f"{least:g} or more" if most is None else f"{least:g} to {most:g}"
        raise InputError(f"`{name}` {shown(plain)} is out of range: give {bounds}")
    if isinstance(plain, str) and not plain.isprintable() and any(0xD800 <= ord(letter) < 0xE000 for letter in plain):
        raise InputError(f"`{name}`: {ascii(plain)[:60]} is not valid text; give it in UTF-8")
    if Path in entry.types and isinstance(plain, str | PurePath):
        checked_path(Path(plain), name)
    if entry.types[0] is Path:
        return Path(cast("PurePath", plain))
    return str(plain) if isinstance(plain, PurePath) else plain


def _is_a(value: object, kind: Any) -> bool:  # noqa: ANN401  a class or several
    if isinstance(value, bool):
        return kind is bool
    return isinstance(value, kind) and not (kind is Sequence and isinstance(value, str | bytes))


def setting_words(settings: Sequence[str] | Mapping[str, object] | None) -> list[str]:
    """Return settings as ``KEY=VALUE`` words, whose values are written as in TOML."""
    if not isinstance(settings, Mapping):
        for word in settings or ():
            if not isinstance(word, str):
                raise InputError(f"`settings`: {shown(word)} is not of the form KEY=VALUE")
        return list(settings or ())
    words: list[str] = []
    for key, value in settings.items():
        if not isinstance(key, str):
            raise InputError(f"`settings`: {shown(key)} is not the key of a setting, for example 'sensor.range_m'")
        if key.count(".") > DEEPEST:
            raise InputError(f"`settings`: {shown(key)} is nested too deeply; there are no such settings")
        if isinstance(value, Mapping):
            words += setting_words({f"{key}.{name}": inner for name, inner in value.items()})
        else:
            words.append(f"{key}={_as_toml(key, value)}")
    return words


def setting_of(key: str, value: object) -> list[str]:
    """Return one setting as a list of words, an empty one where its option is not given."""
    return [] if value is None else setting_words({key: value})


def _as_toml(key: str, value: object) -> str:
    plain = value.tolist() if hasattr(value, "tolist") else value
    try:
        return tomli_w.dumps({"value": str(plain) if isinstance(plain, PurePath) else plain})[8:].strip()
    except (TypeError, RecursionError):
        raise InputError(f"`settings`: {key} can't be set to {shown(value)}; give a number, text or list") from None
