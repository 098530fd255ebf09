"""Scores ``data_0`` beside it with TrackEval (pip install trackeval) by KITTI's rules: cars, in the image.

    python score.py LABELS [SCORE ...]

LABELS is KITTI's folder label_02. HOTA has no sweep over scores: for each SCORE that is given (or for all boxes) a box
counts if the mean score of its track up to there is as high. Choose one on sequences that are not reported.
"""

import argparse
import contextlib
import io
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import trackeval

FRAME, TRACK, SCORE = 0, 1, 17
EVERY_BOX = -np.inf


def kept(lines: list[str], least_score: float) -> list[str]:
    """Return the boxes whose track's mean score so far is high enough; lines are in the order of frames."""
    scores: dict[str, list[float]] = defaultdict(list)
    chosen = []
    for line in lines:
        words = line.split()
        scores[words[TRACK]].append(float(words[SCORE]))
        if np.mean(scores[words[TRACK]]) >= least_score:
            chosen.append(line)
    return chosen


def lay_out(folder: Path, labels: Path, least_score: float) -> trackeval.datasets.Kitti2DBox:
    """Lay labels and boxes out in a folder as TrackEval wants them, and open it."""
    truth, tracks, sequences = folder / "label_02", folder / "trackers" / "these" / "data", []
    truth.mkdir(parents=True)
    tracks.mkdir(parents=True)
    for file in sorted((Path(__file__).resolve().parent / "data_0").glob("*.txt")):
        labelled, found = (labels / file.name).read_text().splitlines(), file.read_text().splitlines()
        frames = 1 + max((int(line.split()[FRAME]) for line in labelled + found), default=0)
        (truth / file.name).write_text("".join(f"{line}\n" for line in labelled))
        (tracks / file.name).write_text("".join(f"{line}\n" for line in kept(found, least_score)))
        sequences.append(f"{file.stem} empty 000000 {frames:06d}\n")
    (folder / "evaluate_tracking.seqmap.these").write_text("".join(sequences))
    folders = {"GT_FOLDER": str(folder), "TRACKERS_FOLDER": str(folder / "trackers")}
    return trackeval.datasets.Kitti2DBox({**folders, "CLASSES_TO_EVAL": ["car"], "SPLIT_TO_EVAL": "these"})


def what_is_asked() -> tuple[Path, list[float]]:
    """Return the folder of labels and the least scores; ends with one line where a sequence's labels are not there."""
    parser = argparse.ArgumentParser(description="Have TrackEval score data_0 beside this script.")
    parser.add_argument("labels", type=Path, help="KITTI's folder label_02")
    parser.add_argument("score", type=float, nargs="*", help="least mean score of a track; all boxes if left out")
    asked = parser.parse_args()
    for file in sorted((Path(__file__).resolve().parent / "data_0").glob("*.txt")):
        if not (asked.labels / file.name).is_file():
            parser.error(f"LABELS: {asked.labels} has no {file.name}; give KITTI's folder label_02")
    return asked.labels, asked.score or [EVERY_BOX]


def main() -> None:
    """Print the scores over all sequences, a line for each least score."""
    labels, least_scores = what_is_asked()
    quiet = {"PRINT_CONFIG": False}
    metrics = (trackeval.metrics.HOTA(), trackeval.metrics.CLEAR(quiet), trackeval.metrics.Identity(quiet))
    names = ("least score", "HOTA", "DetA", "AssA", "MOTA", "IDF1", "switches")
    sys.stdout.write("".join(f"{name:>12}" for name in names) + "\n")
    for least_score in least_scores:
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            data = lay_out(Path(folder), labels, least_score)
            rows = {
                sequence: data.get_preprocessed_seq_data(data.get_raw_seq_data("these", sequence), "car")
                for sequence in data.seq_list
            }
            hota, clear, identity = (
                metric.combine_sequences({sequence: metric.eval_sequence(own) for sequence, own in rows.items()})
                for metric in metrics
            )
        shares = (*(np.mean(hota[name]) for name in ("HOTA", "DetA", "AssA")), clear["MOTA"], identity["IDF1"])
        numbers = "".join(f"{100.0 * share:12.2f}" for share in shares)
        sys.stdout.write(f"{least_score:12g}{numbers}{clear['IDSW']:12.0f}\n")


if __name__ == "__main__":
    main()
