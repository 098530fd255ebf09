"""All evidence about a run, gathered once for every metric."""

from dataclasses import dataclass

import pandas as pd

from harness.scoring.driving.asked import Asked, DriverSetup, ask
from harness.scoring.driving.brakings import Brakings, find_brakings
from harness.scoring.evidence.errors import ErrorArrays, error_arrays, error_table
from harness.scoring.evidence.events import OcclusionEvents, occlusion_events
from harness.scoring.evidence.following import Following, follow
from harness.scoring.evidence.history import DetectionHistory, detection_history
from harness.scoring.evidence.matching import Matching, match
from harness.scoring.evidence.pairs import TrackPairs, near_pairs
from harness.scoring.evidence.plain_view import PlainView, plain_view
from harness.scoring.evidence.rows import RunRows, read_run
from harness.scoring.evidence.sequence import MotSequence, mot_sequence, select_in_sight, select_remembered
from harness.scoring.evidence.unseen import Stretches, count_unseen


@dataclass(frozen=True)
class Evidence:
    """A run, read, matched and tabulated.

    Attributes:
        rows: Vehicles, detections and reported tracks.
        history: What the sensor has had of each vehicle, along the truth rows.
        pairs: Vehicles and tracks that lie near each other.
        matching: Which track stands for which vehicle.
        error_table: One row per vehicle and step, see ``harness.scoring.evidence.errors.error_table``.
        errors: The numbers of that table.
        events: The occlusion events.
        in_sight: Vehicles and tracks in sight.
        remembered: Vehicles detected within the memory, and all tracks.
        plain: Vehicles in plain view, detected or not.
        following: Which track follows which of the vehicles that were once seen, hidden ones included.
        seed: Seed of the run.
        asked: What the ego's driver would do by the truth and by the tracks; None where no driver is asked.
        brakings: Where it would brake by one and not by the other; likewise.
        unseen: Stretches of lane with the vehicles that are expected and that are there without a track; None where
            nobody said what is expected.
    """

    rows: RunRows
    history: DetectionHistory
    pairs: TrackPairs
    matching: Matching
    error_table: pd.DataFrame
    errors: ErrorArrays
    events: OcclusionEvents
    in_sight: MotSequence
    remembered: MotSequence
    plain: PlainView
    following: Following
    seed: int
    asked: Asked | None = None
    brakings: Brakings | None = None
    unseen: Stretches | None = None


def gather(
    truth: pd.DataFrame,
    detections: pd.DataFrame,
    tracks: pd.DataFrame,
    seed: int,
    driven: DriverSetup | None = None,
    unseen: pd.DataFrame | None = None,
) -> Evidence:
    """Read a run's tables and match vehicles with tracks; arguments and errors are those of ``RunScorer.add``."""
    rows = read_run(truth, detections, tracks)
    history = detection_history(rows.truth)
    pairs = near_pairs(rows.truth, rows.tracks)
    matching = match(rows, history, pairs)
    table = error_table(truth, rows, history, matching)
    following = follow(rows, history)
    plain = plain_view(truth, rows)
    asked = None if driven is None else ask(driven, truth, detections, rows)
    return Evidence(
        rows=rows,
        history=history,
        pairs=pairs,
        matching=matching,
        error_table=table,
        errors=error_arrays(table),
        events=occlusion_events(rows, matching),
        in_sight=mot_sequence(rows, history, pairs, select_in_sight(rows, history, pairs)),
        remembered=mot_sequence(rows, history, pairs, select_remembered(rows, history, pairs)),
        plain=plain,
        following=following,
        seed=seed,
        asked=asked,
        brakings=None if asked is None else find_brakings(asked, rows, matching, following, plain),
        unseen=None if unseen is None else count_unseen(unseen, rows, history, matching, following),
    )
