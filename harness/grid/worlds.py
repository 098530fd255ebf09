"""Named worlds that differ from what trackers assume: the settings of each, for live and for finished runs.

A mismatch changes what is true (``sensor.*``: the sensor is simulated anew; ``altered.*``: the detections are altered
after it, which finished runs take as well) or what is believed (``tracker.believes.*``). The data sheet says nothing of
it. Within a world all trackers are given the same detections.
"""

import difflib
import re

from harness.common.errors import InputError
from harness.config.sensor import SensorSettings
from harness.grid.options import USUAL
from harness.storage.schema import AS_IS

ALL = "all"
Worlds = dict[str, tuple[str, ...]]


def usual_worlds(sensor: SensorSettings) -> Worlds:
    """Return the settings of the worlds of ``--mismatch``; those that multiply, on top of the sensor's figures."""
    return {
        AS_IS: (),
        "noise believed x 0.5": ("tracker.believes.noise_factor=0.5",),
        "noise believed x 2": ("tracker.believes.noise_factor=2.0",),
        "detection probability 0.7": ("sensor.detection_probability=0.7",),
        "clutter x 5": (
            f"sensor.clutter_per_scan={5.0 * max(sensor.clutter_per_scan, 0.1):g}",
            f"sensor.persistent_clutter={5.0 * sensor.persistent_clutter:g}",
        ),
        "noise correlated": ("sensor.bias_share=0.9", "sensor.bias_time_s=1.0"),
        "bursts 15 % of 0.8 s": ("sensor.burst_share=0.15", "sensor.burst_s=0.8"),
    }


def altered_worlds(sensor: SensorSettings) -> Worlds:
    """Return the settings of the worlds that are made from the sensor's own detections."""
    return {
        "bursts": ("altered.burst_share=0.15", "altered.burst_s=0.8"),
        "long-bursts": ("altered.burst_share=0.1", "altered.burst_s=2.0"),
        "mirrored": tuple(f"altered.mirrored_clutter{end}" for end in ("=5.0", "_s=4.0", "_probability=0.7")),
        "posts": ("altered.posts_per_km=5.0", "altered.posts_probability=0.9"),
        "fading": ("altered.half_range_m=60.0",),
        "ego-jitter": ("altered.ego_std_m=0.2", "altered.ego_std_deg=0.3"),
        "one-lane": ("tracker.believes.map=one-lane",),
        "5-hz": ("altered.every_scan=2",),
        "blind": ("altered.blind_s=1.0", "altered.blind_every_s=8.0"),
        "fewer": ("altered.kept_probability=0.75",),
        "dark": ("altered.dark_share=0.2", "altered.dark_probability=0.6"),
        "darker": (f"altered.dark_share={1.0 / 7.0:.4f}", "altered.dark_probability=0.35"),
        "none-false": ("altered.false_kept=false",),
        "none-false-fewer": ("altered.false_kept=false", "altered.kept_probability=0.75"),
        "ghosts": (
            "altered.false_kept=false",
            f"altered.clutter_per_scan={sensor.clutter_per_scan:g}",
            f"altered.persistent_clutter={sensor.persistent_clutter:g}",
            *("altered.persistent_clutter_s=10.0", "altered.persistent_clutter_probability=0.9"),
            "altered.persistent_clutter_moving=0.8",
        ),
    }


def worlds(sensor: SensorSettings, *, of_finished: bool) -> Worlds:
    """Return all worlds, as is first."""
    known = usual_worlds(sensor) | altered_worlds(sensor)
    # The same world by another mechanism.
    del known["bursts 15 % of 0.8 s"]
    if not of_finished:
        return known
    more = {
        "clutter x 5": (
            f"altered.clutter_per_scan={4.0 * max(sensor.clutter_per_scan, 0.1):g}",
            f"altered.persistent_clutter={4.0 * sensor.persistent_clutter:g}",
        )
    }
    known = {name: more.get(name, words) for name, words in known.items()}
    return {name: words for name, words in known.items() if not _simulates(words)}


def chosen_worlds(asked: str | None, sensor: SensorSettings, *, of_finished: bool) -> Worlds:
    """Return the requested worlds; the unchanged world is always first.

    Args:
        asked: Names with commas between, or ``all``; None for the usual ones, of finished runs all.
    """
    every = worlds(sensor, of_finished=of_finished)
    if asked == ALL or (asked is None and of_finished):
        return every
    usual = usual_worlds(sensor)
    if asked is None:
        return usual
    known = {_typed(name): (name, words) for name, words in (usual | every).items()}
    chosen: Worlds = {AS_IS: ()}
    for word in filter(None, (part.strip() for part in asked.split(","))):
        if word == USUAL:
            chosen |= usual
            continue
        if _typed(word) not in known:
            near = difflib.get_close_matches(_typed(word), known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"there are {ALL}, {', '.join(known)}"
            raise InputError(f"`mismatch` {word!r}: no such world; {hint}")
        name, words = known[_typed(word)]
        chosen[name] = words
    for name, words in chosen.items():
        if of_finished and _simulates(words):
            raise InputError(
                f"`mismatch` {_typed(name)}: it needs a new sensor simulation, which finished runs in `replay` do "
                "not allow; leave it or `replay` out"
            )
    return chosen


def _simulates(words: tuple[str, ...]) -> bool:
    return any(word.startswith("sensor.") for word in words)


def _typed(name: str) -> str:
    """Return a world's name as it is typed: no spaces."""
    return re.sub(r"[^\w.]+", "-", name.strip().lower()).strip("-")
