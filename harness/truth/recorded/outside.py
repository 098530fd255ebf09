"""Finds external readers of recorded traffic, and checks what they return.

A reader is a function. With one parameter, ``read(path)``, it takes the road from the file; with two,
``read(path, net)``, the traffic drove on a network, whose name it is given. It returns ``ReadTraffic``.
"""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np

from harness.common.error_text import what_it_raised
from harness.common.errors import InputError
from harness.common.named import named
from harness.truth.recorded.rows import ReadTraffic, Rows
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.registry import Entry, Registry

Reader = Callable[..., object]
_ROOM = "harness.truth.recorded"
recording_formats: Registry[Reader] = Registry(
    "format of recorded traffic",
    "harness.recording_formats",
    {
        "commonroad": Entry(f"{_ROOM}.commonroad:read_commonroad"),
        "fcd": Entry(f"{_ROOM}.fcd:read_fcd"),
        "ngsim": Entry(f"{_ROOM}.ngsim:read_ngsim_csv"),
        "highd": Entry(f"{_ROOM}.highd:read_highd"),
        "ngsim-text": Entry(f"{_ROOM}.ngsim:read_ngsim_text"),
        "pandaset": Entry(f"{_ROOM}.pandaset:read_pandaset"),
        "scenarionet": Entry(f"{_ROOM}.scenarionet:read_scenarionet"),
        "gpudrive": Entry(f"{_ROOM}.gpudrive:read_gpudrive"),
        "autoware": Entry(
            f"{_ROOM}.messages:read_bag",
            about="Read the detections of a bag, and as truth its ground truth or else its tracks; without a map.",
            extra="mcap",
        ),
        "kitti-tracking": Entry(f"{_ROOM}.detected.kitti:read_kitti"),
        "av2": Entry(f"{_ROOM}.detected.av2:read_av2"),
    },
    "no such format; known are {in_order}, or module:function for your own",
)


def reader_named(name: str) -> Reader:
    """Return a reader; its module is imported.

    Raises:
        InputError: It can't be imported, or takes other parameters than a path, or a path and a network.
    """
    read = named(recording_formats, "format", name)
    if _parameters(read) not in (1, 2):
        raise InputError(f"`format` {name}: a reader takes (path), or (path, net); this one takes other parameters")
    return read


def brings_road(read: Reader) -> bool:
    """Return whether a reader takes the road from the file."""
    return _parameters(read) == 1


def read_outside(name: str, path: Path, net: str) -> ReadTraffic:
    """Read a recording by another package's reader.

    Raises:
        InputError: The reader fails, or returns what can't be worked with; the message says which check that fails.
    """
    read = reader_named(name)
    try:
        traffic = read(path) if brings_road(read) else read(path, net)
    except InputError:
        raise
    except Exception as error:
        problem = what_it_raised(error)
        raise InputError(f"`format` {name}: it can't read {path} ({problem}); fix the reader or the file") from error
    fault = fault_of(traffic)
    if fault is not None or not isinstance(traffic, ReadTraffic):
        raise InputError(f"`format` {name}: it returned invalid traffic for {path}: {fault}; fix the reader")
    return traffic


def fault_of(traffic: object) -> str | None:
    """Return what is wrong with what a reader returned, in words, or None if it can be put in order."""
    return next(_faults(traffic), None)


def _faults(traffic: object) -> Iterator[str]:
    """Yield what is wrong; what follows the first fault means nothing, and may raise."""
    if not isinstance(traffic, ReadTraffic):
        yield f"{type(traffic).__name__}, not ReadTraffic"
        return
    for name, kinds in (("road", (CorridorRoad, LaneGraphRoad)), ("rows", (Rows,))):
        if not isinstance(getattr(traffic, name), kinds):
            words = " or ".join(kind.__name__ for kind in kinds)
            yield f"{name} is {type(getattr(traffic, name)).__name__}, not {words}"
    yield from _faults_of_names(traffic.names)
    wanted = np.shape(traffic.rows.vehicle)
    for column in fields(Rows):
        fault = _fault_of_column(getattr(traffic.rows, column.name), wanted, is_index=column.name == "vehicle")
        if fault is not None:
            yield f"rows.{column.name} {fault}"
    vehicle, count = traffic.rows.vehicle, len(traffic.names)
    if len(vehicle) and not (vehicle.min() >= 0 and vehicle.max() < count):
        yield f"rows.vehicle has {vehicle.min()} to {vehicle.max()}, and names has {count} entries, counted from 0"
    if not isinstance(traffic.vehicles_read, int | np.integer) or traffic.vehicles_read < len(np.unique(vehicle)):
        yield f"vehicles_read is {traffic.vehicles_read!r}, less than the vehicles that have rows"


def _faults_of_names(names: object) -> Iterator[str]:
    if not isinstance(names, np.ndarray) or names.ndim != 1 or names.dtype.kind != "U":
        yield "names is not an array of strings, shape (v,)"
        return
    if len(np.unique(names)) < len(names):
        yield "names has one name twice"
    if not np.char.str_len(names).all():
        yield "names has an empty one"


def _fault_of_column(values: object, wanted: tuple[int, ...], *, is_index: bool) -> str | None:
    if not isinstance(values, np.ndarray):
        return f"is {type(values).__name__}, not an array"
    if values.shape != wanted or values.ndim != 1:
        return f"has shape {values.shape}, rows.vehicle {wanted}; both must be (n,)"
    kind = "int64" if is_index else "float64"
    return None if values.dtype == kind else f"is {values.dtype}, not {kind}"


def _parameters(read: Reader) -> int:
    """Return how many parameters a reader wants; 0 of one that does not say, or can't be called with so few."""
    try:
        wanted = inspect.signature(read).parameters.values()
    except (TypeError, ValueError):
        return 0
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    needed = [parameter for parameter in wanted if parameter.default is inspect.Parameter.empty]
    return 0 if any(parameter.kind not in positional for parameter in needed) else len(needed)
