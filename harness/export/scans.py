"""What a tracker receives in a run, without truth, so that a tracker can run elsewhere.

``episode-K.txt`` is what ``--tracker exec:`` would write to a program's stdin, so that ``program < episode-0.txt`` is
the same tracker as in a run; ``detections.csv`` and ``ego.csv`` hold the same for programs that read tables.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from harness.running.finished import RecordedRun
from harness.running.follow import StageTimes, follow
from harness.running.open import as_believed
from harness.running.recorder import ColumnRecorder
from harness.running.replay import read_snapshots
from harness.running.snapshots import RandomStreams
from harness.storage.run_folder import DETECTIONS
from harness.storage.schema import TABLES, WHEN
from harness.trackers.program import TIME_LIMITS_S, scan_text, setting_lines
from harness.trackers.protocol import TrackerSetting
from mmpf.scan import Scan
from mmpf.tracks import Tracks

EGO_COLUMNS = ["lon_m", "lat_m", "heading_rad", "speed_mps", "length_m", "width_m"]


@dataclass
class _Listener:
    """Records what a tracker receives, and reports nothing."""

    lines: list[str]
    scans: int = field(default=0)

    def step(self, scan: Scan) -> Tracks:
        self.scans += 1
        self.lines.append(scan_text(scan, self.scans))
        return Tracks.none()


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``episode-0.txt`` and so on, ``detections.csv`` and ``ego.csv``."""
    snapshots = as_believed(read_snapshots(run.folder, run.config), run.config)
    options = {name: value for name, value in run.config.tracker.options.items() if name not in TIME_LIMITS_S}
    told: list[_Listener] = []

    def build(setting: TrackerSetting) -> _Listener:
        told.append(_Listener(list(setting_lines(setting, options))))
        return told[-1]

    follow(snapshots, build, ColumnRecorder(), RandomStreams.from_seed(run.config.seed).tracker, (), StageTimes())
    return list(_written(run, told[1:], folder))  # the first only compiles


def _written(run: RecordedRun, told: list[_Listener], folder: Path) -> Iterator[Path]:
    for number, episode in enumerate(told):
        path = folder / f"episode-{number}.txt"
        path.write_text("".join(episode.lines), encoding="utf-8")
        yield path
    when = [column.name for column in WHEN]
    stds = [name for name in run.detections if str(name).startswith("std_")]
    told_as = 1.0 if (factor := run.config.tracker.believes.noise_factor) is None else factor
    found = run.detections.assign(**{str(name): told_as * run.detections[name] for name in stds})
    shown = [column.name for column in TABLES[DETECTIONS].columns if column.trackers and column.name in run.detections]
    ego = run.truth[run.truth["is_ego"]]
    names = list(dict.fromkeys([*when, *shown]))
    for name, rows in (("detections", found[names]), ("ego", ego[[*when, *EGO_COLUMNS]])):
        yield (path := folder / f"{name}.csv")
        rows.to_csv(path, index=False)
