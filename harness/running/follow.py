"""The tracking loop: the sensor makes a scan, the tracker processes it, the recorder stores both."""

import ctypes
import sys
from array import array
from collections.abc import Callable, MutableSequence, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from harness.common.errors import InputError, RunError
from harness.running.recorder import ColumnRecorder
from harness.running.snapshots import SnapshotStream
from harness.sensor.observation import Snapshot
from harness.trackers.protocol import AnyTracker, TrackerSetting, step_tracker
from harness.trackers.wellformed import blamed_on, described, fault_of, is_own
from harness.truth.frame import OPEN
from mmpf.numerics.arrays import Rows
from mmpf.scan import Scan
from mmpf.tracks import Tracks

TrackerBuilder = Callable[[TrackerSetting], AnyTracker]
Watch = Callable[[Snapshot, Tracks, AnyTracker], object]
COLUMN_TYPES = {name: values.dtype for name, values in vars(Tracks.none()).items()}


@dataclass(frozen=True)
class StageTimes:
    """Wall time of each stage in each step, seconds; of equal length after a finished step.

    The loop waited ``waited_s`` for a snapshot, which is less than truth and sensor took if it was made ahead.
    """

    truth_s: MutableSequence[float] = field(default_factory=lambda: array("d"))
    sensor_s: MutableSequence[float] = field(default_factory=lambda: array("d"))
    tracker_s: MutableSequence[float] = field(default_factory=lambda: array("d"))
    waited_s: MutableSequence[float] = field(default_factory=lambda: array("d"))


def follow(
    snapshots: SnapshotStream,
    build_tracker: TrackerBuilder,
    recorder: ColumnRecorder,
    stream: np.random.SeedSequence,
    watchers: Sequence[Watch],
    times: StageTimes,
) -> None:
    """Give snapshots to trackers, step by step, until they end.

    Each episode, that is each ego, gets a new tracker with its own stream; track identities stay unique over the run.
    """
    keep_freed_memory()
    # Matrix products of filters are small: a second BLAS thread costs more than it gives, far more on a busy machine.
    with threadpool_limits(limits=1, user_api="blas"):
        episodes = _EpisodeTrackers(snapshots, build_tracker, stream)
        asked = perf_counter()
        for snapshot in snapshots:
            waited_s = perf_counter() - asked
            episodes.ready_for(snapshot)
            begin = perf_counter()
            tracks = episodes.step(snapshot)
            tracker_s = perf_counter() - begin
            recorder.add(snapshot, tracks)
            times.truth_s.append(snapshot.truth_s)
            times.sensor_s.append(snapshot.sensor_s)
            times.tracker_s.append(tracker_s)
            times.waited_s.append(waited_s)
            for watch in watchers:
                watch(snapshot, tracks, episodes.tracker)
            asked = perf_counter()


@dataclass
class _EpisodeTrackers:
    """The tracker of the present episode, and the identities that earlier ones used up."""

    snapshots: SnapshotStream
    build_tracker: TrackerBuilder
    stream: np.random.SeedSequence
    episode: int | None = None
    tracker: AnyTracker = field(init=False)
    first_free_id: int = 0
    id_offset: int = 0

    def ready_for(self, snapshot: Snapshot) -> None:
        """Put a new tracker in place if the snapshot's episode is a new one."""
        if snapshot.frame.episode == self.episode:
            return
        if self.episode is None:
            self._compile_once(snapshot)
        self.id_offset = self.first_free_id
        try:
            self.tracker = self._fresh_tracker(self.stream.spawn(1)[0])
        except InputError as error:
            if self.episode is None:
                raise
            # Earlier episodes were followed, and are kept.
            raise RunError(str(error)) from error
        self.episode = snapshot.frame.episode

    def step(self, snapshot: Snapshot) -> Tracks:
        """Give the tracker one scan and make its identities unique over the run."""
        scan = self._told(snapshot)
        tracks = self._stepped(self.tracker, scan, snapshot)
        if (fault := fault_of(tracks)) is not None:
            raise RunError(
                f"the tracker {described(self.tracker)} returned at {scan.time_s:g} s what can't be scored: "
                f"{fault}; `python -m harness check-tracker` has details (docs/how-to/tracker.md)"
            )
        # Identities of eight bits would wrap, and kernels take no other kinds of numbers.
        columns = {name: np.asarray(getattr(tracks, name), kind) for name, kind in COLUMN_TYPES.items()}
        columns["track_id"] = columns["track_id"] + self.id_offset
        self.first_free_id = int(columns["track_id"].max(initial=self.first_free_id - 1)) + 1
        return Tracks(**columns)

    def _stepped(self, tracker: AnyTracker, scan: Scan, snapshot: Snapshot) -> Tracks:
        # What is recorded and scored is not in the hands of others.
        own = scan if is_own(tracker) else deepcopy(scan)
        with blamed_on(tracker, f"at {scan.time_s:g} s"):
            return step_tracker(tracker, own, snapshot.observation.truth_id)

    def _told(self, snapshot: Snapshot) -> Scan:
        """Return what the tracker receives of a snapshot."""
        scan = _as_believed(snapshot.observation.scan, self.snapshots.noise_factor)
        if not self.snapshots.tells_signals or not snapshot.frame.signals:
            return scan
        return replace(scan, open_signals=np.array([letter == OPEN for letter in snapshot.frame.signals]))

    def _fresh_tracker(self, stream: np.random.SeedSequence) -> AnyTracker:
        snapshots, rng = self.snapshots, np.random.default_rng(stream)
        return self.build_tracker(TrackerSetting(snapshots.road, snapshots.sensor, rng, snapshots.step_s))

    def _compile_once(self, snapshot: Snapshot) -> None:
        """Step a tracker that is thrown away, so that compiling kernels counts in no measured step."""
        rehearsal = self._fresh_tracker(np.random.SeedSequence(0))
        for step in range(3):
            told = self._told(snapshot)
            scan = replace(told, time_s=told.time_s + step * self.snapshots.step_s)
            tracks = self._stepped(rehearsal, scan, snapshot)
            if fault_of(tracks) is not None:
                return  # told of the first step that counts


def _as_believed(scan: Scan, noise_factor: float) -> Scan:
    """Return a scan whose detections report that many times the deviations."""
    if noise_factor == 1.0:
        return scan

    def noisier(rows: Rows, *names: str) -> Rows:
        return replace(rows, **{name: noise_factor * getattr(rows, name) for name in names})

    detections = noisier(scan.detections, "std_lon_m", "std_lat_m", "std_speed_mps")
    if detections.sizes is not None:
        detections = replace(detections, sizes=noisier(detections.sizes, "std_length_m", "std_width_m"))
    if detections.headings is not None:
        detections = replace(detections, headings=noisier(detections.headings, "std_rad"))
    return replace(scan, detections=detections)


KEPT_BYTES = {-3: 32 * 2**20, -1: 2**31 - 1, -2: 64 * 2**20}
"""Options of ``mallopt``: the largest M_MMAP_THRESHOLD that is allowed, no M_TRIM_THRESHOLD, and M_TOP_PAD."""
HEAP_BYTES = 6 * [24 * 2**20]
"""Blocks that make the heap 144 MiB large at once; each is below the threshold above, so it lies on the heap."""
HUGE_PAGE, MADV_HUGEPAGE = 2**21, 14
"""Bytes of a large page on x86-64, and the number by which Linux is advised to use such pages."""


def keep_freed_memory() -> None:
    """Tell glibc's allocator to keep freed memory and to serve large arrays from it, in pages of 2 MiB.

    Each step of a tracker lets go of arrays as large as the next step asks for. Handed back to the system, they cost a
    page fault for every 4 KiB when they come back: about a tenth of a step. Looking up so many small pages costs the
    processor about half as much. Other allocators are left as they are.
    """
    libc = ctypes.CDLL(None)
    if sys.platform == "linux" and hasattr(libc, "mallopt"):
        for option, value in KEPT_BYTES.items():
            libc.mallopt(option, value)
        libc.malloc.restype = libc.sbrk.restype = ctypes.c_void_p
        # The heap grows once; freed, the blocks stay part of it.
        blocks = [ctypes.c_void_p(libc.malloc(ctypes.c_size_t(size))) for size in HEAP_BYTES]
        begin, end = -(-(blocks[0].value or 0) // HUGE_PAGE) * HUGE_PAGE, libc.sbrk(0) or 0
        libc.madvise(ctypes.c_void_p(begin), ctypes.c_size_t(max(end - begin, 0)), MADV_HUGEPAGE)
        for block in blocks:
            libc.free(block)
