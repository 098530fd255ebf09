"""Expands the user's lists into a grid: every combination, each a checked configuration.

Trackers are written as a name and, after plus signs, settings of their own: ``mmpf+update=max_likelihood`` or
``mmpf+joint.association.gate_std=4+particles=500``. ``model``, ``update``, ``particles`` and ``model_file`` are the
tracker's named settings, everything else is one of its options. ``cautious=pmbm+birth.share=0.1`` is called cautious in
tables and pictures. ``models`` goes with the project's own tracker; settings of ``tracker.*`` go with it and with
trackers of the user's own, while other built-in trackers keep their tuned settings.
"""

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.config.lists import names, numbers, seed_values
from harness.config.model import DEFAULT_TRACKER, RunConfig
from harness.grid.cells import Cell, GridPlan, PlannedRun
from harness.grid.worlds import chosen_worlds
from harness.running.resolve import resolve_run_config
from harness.sensor.profiles import sensor_settings
from harness.storage.run_folder import is_run_folder
from harness.storage.schema import DEMAND, DENSITY, DENSITY_RANGE, NET, RECORDING
from harness.trackers.catalogue import trackers
from harness.truth.recorded.egos import EACH

MOST_RUNS = 100_000
BELIEFS = "tracker.believes."
NAMED_TRACKER_SETTINGS = ("model", "update", "particles", "model_file")
VARY_EXAMPLE = "sensor.range_m=40:160:20"
NETS_EXAMPLE = "us101,curve,junction"
LABEL = re.compile(r"[\w.-]+")
TRUE_PERCEPTION = "truth"
TRACKER_EXAMPLE = "mmpf,mmpf+update=max_likelihood,stonesoup-jpda"


@dataclass(frozen=True)
class GridRequest:
    """A grid as the user wrote it.

    Attributes:
        net: Network by name, or a path; None with ``nets``. Of recorded traffic ``None`` is the one that its format
            has.
        nets: Several networks, a list; None with ``net``. Each has its default demand where neither densities nor
            demands are given.
        densities: Vehicles per km and lane, a range or list; None with ``demands`` or a network with its own demand.
        vary: ``KEY=VALUES`` words; each is one more axis.
        mismatch: Worlds of ``harness.grid.worlds`` under each of which every run is made: a list, or all; True for the
            usual ones.
    """

    net: str | None = "us101"
    densities: str | None = None
    demands: str | None = None
    trackers: str = DEFAULT_TRACKER
    models: str | None = None
    seeds: str = "10"
    duration_s: float | None = None
    particles: int | None = None
    sensor: str | None = None
    settings: tuple[str, ...] = ()
    vary: tuple[str, ...] = ()
    replay: tuple[str, ...] = ()
    ego: str | None = None
    mismatch: bool | str = False
    nets: str | None = None

    @property
    def networks(self) -> tuple[str | None, ...]:
        """The networks in order; a single None where recorded traffic has its own."""
        return (self.net,) if self.nets is None else names(self.nets, "nets", NETS_EXAMPLE)

    @property
    def title(self) -> str:
        """What its tables and pictures are headed by."""
        return title_of(map(str, self.networks))

    def as_table(self) -> dict[str, Any]:
        """Return it as plain values; ``nets`` only where given, so that grids of one network stay as they were."""
        table = asdict(self)
        return table if self.nets is not None else {key: value for key, value in table.items() if key != "nets"}


def title_of(networks: Iterable[str]) -> str:
    """Return what a grid on these networks is called; one named several times counts once."""
    return f"Stress test on {', '.join(dict.fromkeys(networks))}"


def plan_grid(request: GridRequest) -> GridPlan:
    """Turn what the user wrote into runs, each with a checked configuration.

    Raises:
        InputError: A list is wrong, a key or name is unknown, or there are too many runs.
    """
    places = _traffic_points(request)
    seeds = seed_values(request.seeds)
    axes = _axes(request.vary)
    if twice := axes.keys() & {word.partition("=")[0].strip() for word in request.settings}:
        raise InputError(f"`vary` {min(twice)}: `settings` sets it too; leave one of them out")
    variants = _variants(request)
    mismatches = _mismatches(request)
    sizes = (len(places), len(seeds), len(mismatches), *(len(values) for values in axes.values()), len(variants))
    if math.prod(sizes) > MOST_RUNS:
        raise InputError(
            f"the grid has {math.prod(sizes)} runs, at most {MOST_RUNS} are allowed; fewer densities, seeds or values, "
            "for example `densities` 5:65:10, `seeds` 10"
        )
    shared = {key: values for key, values in axes.items() if not key.startswith("tracker.")}
    beliefs = {key: values for key, values in axes.items() if key.startswith(BELIEFS)}
    own = {key: values for key, values in axes.items() if key not in shared}
    cells = []
    for place, varied, (mismatch, words) in itertools.product(places, _combinations(shared), mismatches.items()):
        # Every configuration is checked once; only the seed differs among those that follow.
        first = [
            PlannedRun(
                _config(replace(request, settings=(*request.settings, *words)), variant, place, seeds[0], each),
                variant.label,
                each,
                mismatch,
            )
            for variant in variants
            for each in (varied | more for more in _combinations(own if variant.takes_settings else beliefs))
        ]
        cells += [
            Cell(tuple(replace(run, config=run.config.model_copy(update={"seed": seed})) for run in first))
            for seed in seeds
        ]
    labels = {variant.label: variant.tracker for variant in variants if variant.label != variant.tracker}
    return GridPlan(tuple(cells), tuple(axes), labels)


@dataclass(frozen=True)
class _Variant:
    """A tracker with settings of its own and, where it takes one, a model.

    Attributes:
        tracker: Its name and settings as they were written.
    """

    label: str
    tracker: str
    name: str
    settings: tuple[str, ...]
    model: str | None = None

    @property
    def takes_settings(self) -> bool:
        """Whether ``tracker.*`` settings that hold for the whole grid concern it."""
        return self.name == DEFAULT_TRACKER or ":" in self.name


def _variants(request: GridRequest) -> list[_Variant]:
    models = names(request.models, "models", "gmm,idm,cvm,cam") if request.models is not None else (None,)
    variants: list[_Variant] = []
    for text in names(request.trackers, "trackers", TRACKER_EXAMPLE):
        label, tracker = _labelled(text)
        name, *settings = tracker.split("+")
        for setting in settings:
            key, equals, value = setting.partition("=")
            if not (key and equals and value):
                raise InputError(
                    f"`trackers` {text}: {setting!r} is not KEY=VALUE; for example mmpf+update=max_likelihood"
                )
        crossed = name == DEFAULT_TRACKER and not any(setting.startswith("model=") for setting in settings)
        full = tuple(
            f"tracker.{each}" if each.partition("=")[0] in NAMED_TRACKER_SETTINGS else f"tracker.options.{each}"
            for each in settings
        )
        if label in (variant.label for variant in variants):
            raise InputError(f"`trackers` {text}: another tracker is called {label} too; choose another name")
        variants += [_Variant(label, tracker, name, full, model) for model in (models if crossed else (None,))]
    takers = {
        "models": any(one.model for one in variants),
        "particles": any(one.name == DEFAULT_TRACKER for one in variants),
    }
    for name, taken in takers.items():
        if getattr(request, name) is not None and not taken:
            raise InputError(f"`{name}`: only mmpf takes them here; for example `trackers` mmpf, `models` gmm,cvm")
    for name in () if any(one.takes_settings for one in variants) else ("settings", "vary"):
        for key in (word.partition("=")[0].strip() for word in getattr(request, name)):
            if key.startswith("tracker.") and not key.startswith(BELIEFS):
                own = f"{variants[0].tracker}+{key.removeprefix('tracker.').removeprefix('options.')}=VALUE"
                raise InputError(f"`{name}` {key}: it goes to mmpf, which is not asked for; write `trackers` {own}")
    return variants


def _labelled(text: str) -> tuple[str, str]:
    """Return a tracker's label and the tracker; without ``LABEL=`` it is called as it is written."""
    label, _, tracker = text.partition("=")
    if not tracker or not LABEL.fullmatch(label):
        return text, text
    if label in (TRUE_PERCEPTION, *trackers):
        raise InputError(f"`trackers` {text}: {label} is the name of another tracker; for example my-{label}={tracker}")
    return label, tracker


def _traffic_points(request: GridRequest) -> list[dict[str, Any]]:
    if request.densities is not None and request.demands is not None:
        raise InputError("`demands`: give either densities or demands, not both; for example `densities` 5:65:10")
    if request.replay and (request.densities is not None or request.demands is not None):
        raise InputError("`replay`: recorded traffic is as it was; leave densities and demands out")
    if request.ego is not None and not request.replay:
        raise InputError("`ego`: simulated traffic has no such choice; add `replay`, recorded traffic")
    if request.nets is not None and request.net is not None:
        raise InputError(f"`nets`: give either net or nets, not both; for example `nets` {NETS_EXAMPLE}")
    if request.nets is not None and request.replay:
        raise InputError("`nets`: recorded traffic drives on its own road; leave nets out with `replay`")
    traffic: list[dict[str, Any]] = [{}]
    if request.demands is not None:
        traffic = [{DEMAND: name} for name in names(request.demands, "demands", "us101-0750,us101-0805")]
    elif request.densities is not None:
        traffic = [{DENSITY: value} for value in numbers(request.densities, "densities", "5:65:10")]
    if request.replay:
        if len({Path(path).name for path in request.replay}) < len(request.replay):
            raise InputError("`replay`: two of the files have the same name, which identifies results; rename one")
        # A run's folder has its ego; asking for one is refused where its configuration is made.
        egos = [request.ego or (None if is_run_folder(Path(path)) else EACH) for path in request.replay]
        return [{RECORDING: path, "ego": ego} for path, ego in zip(request.replay, egos, strict=True)]
    return [{NET: net, **point} for net in request.networks for point in traffic]


def _axes(words: Sequence[str]) -> dict[str, tuple[float, ...]]:
    axes: dict[str, tuple[float, ...]] = {}
    for word in words:
        key, equals, text = (part.strip() for part in word.partition("="))
        if not equals or not key:
            raise InputError(
                f"`vary` {word!r}: give KEY=START:STOP:STEP or KEY=A,B,C; for example `vary` {VARY_EXAMPLE}"
            )
        if key in axes:
            raise InputError(f"`vary` {key}: given twice; for example `vary` {VARY_EXAMPLE}")
        if instead := {"seed": "`seeds` 10", "traffic.density": "`densities` 5:65:10"}.get(key):
            raise InputError(f"`vary` {key}: this axis has its own option; for example {instead}")
        if not key.startswith(("sensor.", "tracker.", "traffic.")):
            raise InputError(f"`vary` {key}: no such setting can be varied; for example `vary` {VARY_EXAMPLE}")
        axes[key] = numbers(text, "vary", VARY_EXAMPLE)
    return axes


def _mismatches(request: GridRequest) -> Mapping[str | None, tuple[str, ...]]:
    """Return the settings of each mismatch by its name; those of no mismatch by default."""
    if not request.mismatch:
        return {None: ()}
    folders = [path for path in request.replay if is_run_folder(Path(path))]
    if 0 < len(folders) < len(request.replay):
        raise InputError("`mismatch`: give finished runs or files of recorded traffic in `replay`, not both")
    words = [word for word in request.settings if word.startswith("sensor.")]
    options = {"sensor": request.sensor, "replay": folders[0] if folders else None}
    sensor = resolve_run_config(None, options, words).sensor
    settings = sensor_settings(sensor.profile, sensor.overrides)
    asked = request.mismatch if isinstance(request.mismatch, str) else None
    return dict(chosen_worlds(asked, settings, of_finished=bool(folders)).items())


def _combinations(axes: Mapping[str, Sequence[float]]) -> Iterator[dict[str, float]]:
    for values in itertools.product(*axes.values()):
        yield dict(zip(axes, values, strict=True))


def _config(
    request: GridRequest, variant: _Variant, place: Mapping[str, Any], seed: int, varied: Mapping[str, float]
) -> RunConfig:
    options = {
        "net": request.net,
        **place,
        "duration": request.duration_s,
        "sensor": request.sensor,
        "tracker": variant.name,
        "model": variant.model,
        "particles": request.particles if variant.name == DEFAULT_TRACKER else None,
        "seed": seed,
    }
    # Others than the tracker's own concern every tracker, not only those that take the grid's.
    of_all = [word for word in request.settings if word.startswith(BELIEFS) or not word.startswith("tracker.")]
    settings = request.settings if variant.takes_settings else of_all
    words = [f"{key}={int(value) if value.is_integer() else value}" for key, value in varied.items()]
    low, high = DENSITY_RANGE
    if place.get(DENSITY) is not None and not low <= place[DENSITY] <= high:
        raise InputError(f"`densities` {place[DENSITY]:g}: give {low:g} to {high:g}; for example `densities` 5:65:10")
    try:
        return resolve_run_config(None, options, [*settings, *variant.settings, *words])
    except InputError as error:
        raise with_example(error, varied) from None


def with_example(error: InputError, varied: Iterable[str]) -> InputError:
    """Return the error, with an example of ``vary`` where it is about one of its keys."""
    if any(key.split(".", 1)[-1] in str(error) for key in varied):
        return InputError(f"`vary`: {error}; for example `vary` {VARY_EXAMPLE}")
    return error
