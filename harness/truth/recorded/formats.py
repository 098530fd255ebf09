"""The formats of recorded traffic, recognised by a file's content and never by its name.

A format that another package brings is only taken where it is named: nothing of others is imported to recognise a file.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from harness.common.errors import InputError
from harness.common.isolation import ProcessLimits, isolated
from harness.common.named import named
from harness.common.untrusted_files import check_file, checked_path, unpacked
from harness.truth.frame import ROAD_OF_RECORDING
from harness.truth.recorded import fcd, highd, outside
from harness.truth.recorded.detected.recorded_drive import Drive
from harness.truth.recorded.outside import recording_formats
from harness.truth.recorded.rows import ReadTraffic
from mmpf.map.lane_graph import compile_kernels

T = TypeVar("T")
PARAMETER = "replay"
HEAD_BYTES = 65_536
LONGEST_HEADER = 4_096

NGSIM_NAMES = frozenset(
    {"vehicle_id", "frame_id", "total_frames", "global_time", "local_x", "local_y", "v_vel", "lane_id"}
)
HIGHD_NAMES = frozenset({"frame", "id", "x", "y", "width", "height", "xvelocity", "yvelocity", "laneid"})
PANDASET_NAMES = frozenset({"timestamp", "uuid", "label", "yaw", "position.x", "position.y", "dimensions.x"})
EXAMPLES = {"pandaset": Path(__file__).parent / "examples" / "pandaset-002.csv.gz"}
"""Recordings that come with the project, by the names that stand for them."""
PICKLE = "a pickle"
PICKLES = tuple(bytes([0x80, protocol]) for protocol in range(2, 6))
"""What pickles begin with, by the protocols that hold arrays."""
BAG, BAG_BEGINS = "autoware", b"\x89MCAP"
"""The format that is read as a log, and what an MCAP file begins with."""
# So many of a format's names tell it; the rest may be missing, and is named then.
TELLING_NAMES = 5
NGSIM_TEXT_COLUMNS = 18


@dataclass(frozen=True)
class RecordingFormat:
    """A format of recorded traffic.

    Attributes:
        sensor: Profile that tells what is known of the detector whose boxes a recording brings; its reader returns
            drives (``harness.truth.recorded.detected``). None of one that brings no detections.
        least_score: Detections of a lower score are left out unless the user says otherwise.
        scores: What the detector's scores mean, see ``GivenDetections``.
        brings_map: Whether a recording that brings detections may have a map beside it; its reader then takes whether
            to read it as well.
    """

    name: str
    brings_road: bool
    recognises: Callable[[str], bool]
    sensor: str | None = None
    least_score: float = -np.inf
    scores: tuple[float, float] | None = None
    brings_map: bool = False
    usual_ego: str = "auto"

    def read(self, path: Path, net: str) -> ReadTraffic:
        """Read a file that was driven on a network."""
        if self.name not in FORMATS:
            return outside.read_outside(self.name, path, net)
        read = cast("Callable[..., ReadTraffic]", recording_formats[self.name])
        return read(path) if self.brings_road else read(path, net)

    def drives(self, path: Path, with_map: bool) -> tuple[Drive, ...]:
        """Read a recording with its own detections, with or without its map."""
        read = cast("Callable[..., tuple[Drive, ...]]", recording_formats[self.name])
        return read(path, with_map) if self.brings_map else read(path)

    def own_files(self, path: Path) -> tuple[Path, ...]:
        """Return the files of a recording with its own detections."""
        files: tuple[Path, ...] = import_module(recording_formats[self.name].__module__).files_of(path)
        return files


def example(path: Path) -> Path:
    """Return the recording that comes with the project if a path is its name and no such path exists, else the path."""
    return path if path.exists() else EXAMPLES.get(str(path), path)


def recognise(path: Path, forced: str | None = None) -> RecordingFormat:
    """Return the format of a file or folder; only its first bytes are read.

    Args:
        path: The file, or the folder of a highD recording.
        forced: Name of the format, if the user says so; ``module:function`` for a reader of one's own.

    Raises:
        InputError: The file is missing, empty or binary, its format is unknown, or there is no format of that name.
    """
    if not isinstance(forced, str | None):
        raise InputError(f"`format` {str(forced)[:40]}: give the name of a format, a text")
    if forced is not None and forced not in FORMATS and not recording_formats.is_outside(forced):
        named(recording_formats, "format", forced)
    if not checked_path(path, PARAMETER).exists():
        raise InputError(f"`{PARAMETER}`: {path} does not exist; give a run's folder or a file of recorded traffic")
    if not path.is_dir():
        check_file(path, PARAMETER)
    if forced is not None and forced not in FORMATS:
        return RecordingFormat(forced, outside.brings_road(outside.reader_named(forced)), _is_never_recognised)
    head = "" if path.is_dir() else _head(path)
    if forced is not None:
        return FORMATS[forced]
    if path.is_dir():
        if any(path.glob("*_tracks.csv")):
            return FORMATS["highd"]
        raise InputError(
            f"`{PARAMETER}`: {path} is not a run's folder: manifest.json is missing or broken; "
            "nor has it a highD recording"
        )
    if head in (PICKLE, BAG):
        return FORMATS["scenarionet" if head == PICKLE else BAG]
    for entry in FORMATS.values():
        if entry.recognises(head):
            return entry
    raise InputError(
        f"`{PARAMETER}`: {path} is no recorded traffic that is known here ({', '.join(FORMATS)}); name it with `format`"
    )


def network_of(entry: RecordingFormat, net: str | None) -> str:
    """Return the network that a recording is driven on.

    Raises:
        InputError: The format brings its own road and another one is asked for, or the other way round.
    """
    if entry.brings_road:
        if net not in (None, ROAD_OF_RECORDING):
            raise InputError(f"`net` {net}: a {entry.name} recording brings its own road; leave `net` out")
        return ROAD_OF_RECORDING
    if net == ROAD_OF_RECORDING:
        raise InputError(f"`net` {net}: a {entry.name} recording has no road of its own; name a network")
    return net if net is not None else "us101"


def read_traffic(path: Path, format_name: str, net: str) -> ReadTraffic:
    """Read a recording whose format is known.

    Raises:
        InputError: The file is broken or does not fit the network.
    """
    entry = recognise(path, format_name)
    if entry.sensor is not None or entry.name == BAG:
        raise InputError(f"`format` {entry.name}: it brings its own detections, which only run and stress replay")
    road = network_of(entry, net)
    return apart(lambda: entry.read(path, road), path, entry.name)


def brings_detections(format_name: str) -> bool:
    """Return whether recordings of a format hold a real detector's boxes beside the truth."""
    return format_name in FORMATS and FORMATS[format_name].sensor is not None


def check_map(format_name: str) -> None:
    """Refuse to take the map beside a recording as its road where the format has none.

    Raises:
        InputError: It has none.
    """
    if format_name not in FORMATS or not FORMATS[format_name].brings_map:
        having = ", ".join(name for name, entry in FORMATS.items() if entry.brings_map)
        raise InputError(
            f"`traffic.recording.map`: only {having} has a map beside it, {format_name} does not; leave it out"
        )


def least_score_of(name: str, chosen: float | None) -> float:
    """Return below which score a format's detections are left out: as the user chose, or else as the format has it."""
    return FORMATS[name].least_score if chosen is None else chosen


def read_drives(path: Path, format_name: str, with_map: bool = False) -> tuple[Drive, ...]:
    """Read a recording with its own detections, whose format is known.

    Raises:
        InputError: A file is missing or broken, or they contradict each other.
    """
    entry = recognise(path, format_name)
    return apart(lambda: entry.drives(path, with_map), path, entry.name)


def apart(work: Callable[[], T], path: Path, format_name: str) -> T:
    """Return what comes of work on a recording, in a process of its own unless other people's code has to read it.

    Raises:
        InputError: The work fails.
    """

    def quietly() -> T:
        # Numbers that overflow are refused later, by name; NumPy's own warnings would only be more lines.
        with np.errstate(all="ignore"):
            return work()

    if format_name not in FORMATS:
        return quietly()
    files = files_of(path, format_name)
    for file in files:
        check_file(file, PARAMETER)
    if FORMATS[format_name].brings_road:
        compile_kernels()
    return isolated(quietly, f"{path} ({format_name})", ProcessLimits.for_files(files))


def files_of(path: Path, format_name: str) -> tuple[Path, ...]:
    """Return the files of a recording: the file itself and those beside it that belong to it, or all of a folder."""
    if format_name not in FORMATS:
        return tuple(sorted(file for file in path.iterdir() if file.is_file())) if path.is_dir() else (path,)
    if FORMATS[format_name].sensor is not None:
        return FORMATS[format_name].own_files(path)
    if format_name == "fcd" and not path.is_dir():
        return fcd.recording_files(path)
    if not path.is_dir() and not path.name.endswith("_tracks.csv"):
        return (path,)
    return highd.recording_files(path)


def _head(path: Path) -> str:
    try:
        with unpacked(path) as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(f"`{PARAMETER}`: can't read {path}: {error.strerror}") from None
    if not head.strip():
        raise InputError(f"`{PARAMETER}`: {path} is empty; give a file of recorded traffic")
    if head.startswith(PICKLES):
        return PICKLE
    if head.startswith(BAG_BEGINS):
        return BAG
    if b"\0" in head:
        raise InputError(f"`{PARAMETER}`: {path} is a binary file; recorded traffic is text: {', '.join(FORMATS)}")
    try:
        # A character may be cut in two at the end of the head.
        return head.decode("utf-8-sig", errors="strict" if len(head) < HEAD_BYTES else "ignore")
    except UnicodeDecodeError:
        raise InputError(f"`{PARAMETER}`: {path} is no text; recorded traffic is text: {', '.join(FORMATS)}") from None


def _header_names(head: str) -> set[str]:
    line = head.lstrip().partition("\n")[0][:LONGEST_HEADER]
    return {name.strip().strip('"').lower() for name in line.split(",")}


def _with_element(name: str) -> Callable[[str], bool]:
    return lambda head: re.search(rf"<{name}[\s>]", head) is not None


def _with_columns(names: frozenset[str]) -> Callable[[str], bool]:
    return lambda head: len(_header_names(head) & names) >= TELLING_NAMES


def _is_never_recognised(_: str) -> bool:
    return False


def _is_gpudrive(head: str) -> bool:
    return head.lstrip().startswith("{") and '"objects"' in head and '"position"' in head


def _is_ngsim_text(head: str) -> bool:
    """Whether the lines are 18 numbers without a header; one or two too few or too many are named later."""
    words = head.lstrip().partition("\n")[0][:LONGEST_HEADER].split()
    if abs(len(words) - NGSIM_TEXT_COLUMNS) > 2:
        return False
    return all(re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", word, re.IGNORECASE) for word in words)


FORMATS: dict[str, RecordingFormat] = {
    entry.name: entry
    for entry in (
        RecordingFormat("commonroad", True, _with_element("commonRoad")),
        RecordingFormat("fcd", False, _with_element("fcd-export")),
        RecordingFormat("ngsim", False, _with_columns(NGSIM_NAMES)),
        RecordingFormat("highd", True, _with_columns(HIGHD_NAMES)),
        RecordingFormat("ngsim-text", False, _is_ngsim_text),
        RecordingFormat("pandaset", True, _with_columns(PANDASET_NAMES), usual_ego="ego"),
        RecordingFormat("scenarionet", True, _is_never_recognised, usual_ego="ego"),
        RecordingFormat("gpudrive", True, _is_gpudrive),
        RecordingFormat(BAG, True, _is_never_recognised, usual_ego="ego"),
        RecordingFormat("kitti-tracking", True, _is_never_recognised, "kitti-pointrcnn", 2.0, (3.69, 1.40)),
        RecordingFormat("av2", True, _is_never_recognised, "av2-points", brings_map=True),
    )
}
