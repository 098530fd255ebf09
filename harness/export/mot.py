"""A run in MOTChallenge's text format, laid out as TrackEval's ``MotChallenge2DBox`` expects it.

The picture is the road from above, one pixel a centimetre: x runs along the road, y to the right of the driving
direction. There is a sequence for each of the two sets of vehicles that the run's own scores are over, so that
TrackEval on these files scores the same vehicles and tracks. Tracks' boxes are as large as what was measured of them.
Where the road has no frame of its own x and y are the plane's, and since boxes of this format can't be turned all of
them are squares as long as a usual car.
"""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from harness.export.sizes import track_sizes
from harness.running.finished import RecordedRun
from harness.scoring.evidence.history import DetectionHistory, detection_history
from harness.scoring.evidence.pairs import TrackPairs, near_pairs
from harness.scoring.evidence.rows import RunRows, read_run
from harness.scoring.evidence.sequence import Selection, mot_sequence, select_in_sight, select_remembered
from harness.storage.schema import NOMINAL_LENGTH_M
from mmpf.numerics.arrays import FloatArray, IntArray

PIXELS_PER_M = 100.0
SCRIPT = "trackeval_script.py"
Select = Callable[[RunRows, DetectionHistory, TrackPairs], Selection]
SEQUENCES: dict[str, Select] = {"in-sight": select_in_sight, "seen-in-10-s": select_remembered}
# The one class that TrackEval evaluates in this format.
EVALUATED_CLASS = 1

README = """Multi-object tracking files of a run, in the format of MOTChallenge, from above: 1 pixel is 1 cm.

  pip install trackeval
  python score.py              # by position: the run's own HOTA, MOTA, IDF1 and switches
  python score.py --overlap    # by the overlap of boxes, TrackEval's usual similarity: lower, see there

Boxes of tracks are as large as the median of the sizes that the sensor measured of them; a usual car's where it
measured none (radar).
"""


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``gt/<sequence>/gt/gt.txt`` with ``seqinfo.ini``, ``trackers/<tracker>/data/<sequence>.txt``, a seqmap."""
    rows = read_run(run.truth, run.detections, run.tracks)
    history = detection_history(rows.truth)
    pairs = near_pairs(rows.truth, rows.tracks)
    files = [_written(folder / "README.txt", README)]
    files.append(Path(shutil.copyfile(Path(__file__).with_name(SCRIPT), folder / "score.py")))
    files.append(_written(folder / "seqmap.txt", "\n".join(["name", *SEQUENCES]) + "\n"))
    sizes = track_sizes(run, rows.episode[rows.tracks.step], rows.tracks.track_id)
    for name, select in SEQUENCES.items():
        selection = select(rows, history, pairs)
        sequence = mot_sequence(rows, history, pairs, selection)
        truth_row = rows.truth.name_row[selection.truth]
        size_m = run.truth[["length_m", "width_m"]].to_numpy(dtype=np.float64)[truth_row]
        if rows.has_headings:
            size_m, sizes = (np.full_like(each, NOMINAL_LENGTH_M) for each in (size_m, sizes))
        truth_boxes = _boxes(rows.truth.lon_m[selection.truth], rows.truth.lat_m[selection.truth], size_m)
        visible = run.truth["visible_fraction"].to_numpy(dtype=np.float64)[truth_row]
        truth_lines = _lines(
            sequence.truth_step, sequence.truth_identity, truth_boxes, [f"1,{EVALUATED_CLASS},{v:.4f}" for v in visible]
        )
        chosen = selection.tracks
        track_boxes = _boxes(rows.tracks.lon_m[chosen], rows.tracks.lat_m[chosen], sizes[chosen])
        track_lines = _lines(
            sequence.track_step, sequence.track_identity, track_boxes, ["1,-1,-1,-1"] * len(track_boxes)
        )
        info = f"[Sequence]\nname={name}\nframeRate={1.0 / run.step_s:g}\nseqLength={len(rows.time_s)}\n"
        files += [
            _written(folder / "gt" / name / "gt" / "gt.txt", truth_lines),
            _written(folder / "gt" / name / "seqinfo.ini", info),
            _written(folder / "trackers" / folder_name(run.config.tracker.name) / "data" / f"{name}.txt", track_lines),
        ]
    return files


def folder_name(tracker: str) -> str:
    """Return a tracker's name as a safe folder name: an external run's name must not be a path."""
    return re.sub(r"[^\w.+-]+", "-", tracker).lstrip(".-")[:60] or "tracker"


def _boxes(lon_m: FloatArray, lat_m: FloatArray, size_m: FloatArray) -> FloatArray:
    """Return left, top, width and height in pixels, shape (n, 4), of bodies that point along the road."""
    length, width = size_m.T
    return PIXELS_PER_M * np.stack([lon_m - 0.5 * length, -lat_m - 0.5 * width, length, width], axis=-1)


def _lines(step: IntArray, identity: IntArray, boxes: FloatArray, ends: list[str]) -> str:
    """Return one line for each row in the order of time; frames and identities count from 1."""
    rows = zip(step.tolist(), identity.tolist(), boxes.tolist(), ends, strict=True)
    ordered = sorted(rows, key=lambda row: (row[0], row[1]))
    return "".join(
        f"{frame + 1},{number + 1},{box[0]:.4f},{box[1]:.4f},{box[2]:.4f},{box[3]:.4f},{end}\n"
        for frame, number, box, end in ordered
    )


def _written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path
