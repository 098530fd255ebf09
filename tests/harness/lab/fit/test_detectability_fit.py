"""The fit of detectability finds a law that is known, on vehicles that are made up."""

import numpy as np
import pytest

from harness.lab.fit.detectability_fit import Recalls, fit_beta_binomial, main, recalls_of, without_long_runs
from harness.truth.recorded.detected.recorded_drive import Drive, EgoPath, GivenBoxes, Labels

STEPS = 12


def drive_of(labels: list[tuple[int, int, float, float]], given: list[tuple[int, float, float]]) -> Drive:
    """Return a drive of labels (thing, step, x, y) and detections (step, x, y), boxes of 4 m by 2 m along x."""
    labels = sorted(labels, key=lambda row: row[1])
    thing, step, x, y = (np.array(column) for column in zip(*labels, strict=True))
    box = np.zeros(len(x)), np.full(len(x), 4.0), np.full(len(x), 2.0)
    yes = np.ones(len(x), dtype=bool)
    found = sorted(given)
    at, gx, gy = (np.array(column, dtype=float) for column in zip(*found, strict=True))
    boxes = np.zeros(len(at)), np.full(len(at), 4.0), np.full(len(at), 2.0)
    still = np.zeros(STEPS)
    return Drive(
        "made up",
        EgoPath(still, still, still),
        np.array(["a", "b", "c"]),
        Labels(step, x.astype(float), y.astype(float), *box, thing, yes, ~yes),
        GivenBoxes(at.astype(np.int64), gx, gy, *boxes, np.ones(len(at))),
    )


def test_the_beta_law_behind_made_up_vehicles_is_found_again():
    rng = np.random.default_rng(1000)
    frames = rng.integers(10, 80, size=4000)
    found = rng.binomial(frames, rng.beta(6.0, 1.5, size=4000))
    first, second = fit_beta_binomial(Recalls(frames, found))
    assert (first, second) == (pytest.approx(6.0, rel=0.08), pytest.approx(1.5, rel=0.08))


def test_misses_count_unless_they_are_in_a_run_of_a_second():
    short, long = [True] * 3 + [False] * 9 + [True], [True] + [False] * 10 + [True] * 2
    assert without_long_runs(np.array(short)).tolist() == [True] * 13
    assert without_long_runs(np.array(long)).tolist() == [True] + [False] * 10 + [True] * 2


def test_vehicles_count_over_their_frames_in_plain_view_if_they_are_ten_or_more():
    # Of three vehicles one is found in every other frame, one in all but is seen in six, one is too far away.
    labels = [(0, step, 20.0, 0.0) for step in range(STEPS)] + [(1, step, 40.0, 6.0) for step in range(6)]
    labels += [(2, step, 70.0, -6.0) for step in range(STEPS)]
    given = [(step, 20.2, 0.0) for step in range(0, STEPS, 2)] + [(step, 40.0, 6.0) for step in range(6)]
    given += [(step, 70.0, -6.0) for step in range(STEPS)]
    recalls = recalls_of([drive_of(labels, given)])
    assert (recalls.frames.tolist(), recalls.found.tolist()) == ([STEPS], [STEPS // 2])


def test_a_folder_without_sequences_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--kitti", str(tmp_path)])
    assert ended.value.code == 2
    assert "label_02" in capsys.readouterr().err
