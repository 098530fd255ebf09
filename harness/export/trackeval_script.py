"""Scores the MOTChallenge files beside it with TrackEval (pip install trackeval), by position as the run's own scores.

    python score.py

TrackEval's usual similarity, the overlap of boxes, asks more of a box's place than of a track's: 0.5 m of 4.5 m cost a
fifth. Here it is 1 at the same place and 0.5 at the edge of the gate, as in the run's own scores; with --overlap it is
TrackEval's.
"""

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trackeval

Boxes = npt.NDArray[np.float64]
PIXELS_PER_M = 100.0
GATE_M = np.array([4.0, 2.0])  # along and across the road


class ByPosition(trackeval.datasets.MotChallenge2DBox):
    """TrackEval's reader of the format, with the similarity of positions in place of the overlap of boxes."""

    def _calculate_similarities(self, gt_dets_t: Boxes, tracker_dets_t: Boxes) -> Boxes:
        truth, tracks = ((boxes[:, :2] + 0.5 * boxes[:, 2:4]) / PIXELS_PER_M for boxes in (gt_dets_t, tracker_dets_t))
        off = np.abs(truth[:, None] - tracks[None]) / (2.0 * GATE_M)
        similarity: Boxes = np.clip(1.0 - off.max(axis=-1), 0.0, 1.0)
        return similarity


def main() -> None:
    """Print the scores of each sequence."""
    here = Path(__file__).resolve().parent
    reader = trackeval.datasets.MotChallenge2DBox if "--overlap" in sys.argv else ByPosition
    data = reader(
        {
            "GT_FOLDER": str(here / "gt"),
            "TRACKERS_FOLDER": str(here / "trackers"),
            "SKIP_SPLIT_FOL": True,
            "SEQMAP_FILE": str(here / "seqmap.txt"),
            "DO_PREPROC": False,
            "PRINT_CONFIG": False,
        }
    )
    quiet = {"PRINT_CONFIG": False}
    metrics = (trackeval.metrics.HOTA(), trackeval.metrics.CLEAR(quiet), trackeval.metrics.Identity(quiet))
    sys.stdout.write(f"{'':16}{'HOTA':>8}{'AssA':>8}{'MOTA':>8}{'IDF1':>8}{'switches':>10}\n")
    for tracker in data.tracker_list:
        for sequence in data.seq_list:
            rows = data.get_preprocessed_seq_data(data.get_raw_seq_data(tracker, sequence), "pedestrian")
            hota, clear, identity = (metric.eval_sequence(rows) for metric in metrics)
            percent = (np.mean(hota["HOTA"]), np.mean(hota["AssA"]), clear["MOTA"], identity["IDF1"])
            numbers = "".join(f"{100.0 * value:8.2f}" for value in percent)
            sys.stdout.write(f"{sequence:16}{numbers}{clear['IDSW']:10.0f}\n")


if __name__ == "__main__":
    main()
