"""Every switch and every lost track has one cause, and the causes add up."""

import numpy as np
import pytest

from harness.analysis import why
from harness.scoring.gathered import gather
from harness.scoring.metrics.registry import score_metrics
from tests.harness.scoring.scenes import Scene

STEPS = 60
Spans = list[tuple[int, int, int, float]]
"""Tracks as (number, first step, last step, lane they are on)."""


def scene(tracks: Spans, unseen: tuple[int, int] | None = None) -> list[why.TrackFailure]:
    """Return the failures over two cars in lanes 0 and 4 m, of which the first is hidden for a time."""
    step, driven = np.arange(STEPS), Scene(STEPS)
    first, last = unseen or (STEPS, STEPS)
    hidden = (first <= step) & (step <= last)
    driven.vehicle("one", 2.0 * step, 0.0, np.where(hidden, "hidden", "visible"), ~hidden, speed=20.0)
    driven.vehicle("two", 2.0 * step, 4.0, detected=True, speed=20.0)
    for number, first, last, lane in tracks:
        at = step[first : last + 1]
        driven.track(number, 2.0 * at, lane, at, speed=20.0, std=0.1)
    evidence = gather(*driven.tables(), 0)
    found = why.failures(evidence)
    metrics = score_metrics(evidence)
    assert sum(each.kind == why.SWITCH for each in found) == metrics["mot"]["id_switches"]
    losses = evidence.error_table[(evidence.error_table["outcome"] == "lost")]
    assert sum(each.kind == why.LOSS for each in found) == len(losses["vehicle_id"].unique())
    return found


TWO = (2, 0, STEPS - 1, 4.0)
NEW, ON_NOTHING = (3, 35, STEPS - 1, 0.0), (1, 20, STEPS - 1, -9.0)


def test_a_perfect_tracker_fails_nowhere():
    assert scene([(1, 0, STEPS - 1, 0.0), TWO]) == []


def test_a_track_that_ends_with_nobody_near_died():
    (found,) = scene([(1, 0, 29, 0.0), (3, 31, STEPS - 1, 0.0), TWO])
    assert (found.kind, found.cause) == (why.SWITCH, why.DEATH)
    assert (found.vehicle_id, found.before, found.after) == ("one", 1, 3)
    assert found.time_s == pytest.approx(3.1)


@pytest.mark.parametrize(
    ("tracks", "unseen", "told"),
    [
        ([(1, 0, 29, 0.0), (3, 20, STEPS - 1, 0.6), TWO], None, [(why.SWITCH, why.MERGE)]),
        # The old one drifts off onto nothing while the new one is on the vehicle.
        ([(1, 0, 29, 0.0), (1, 30, STEPS - 1, -9.0), (3, 30, STEPS - 1, 0.0), TWO], None, [(why.SWITCH, why.BIRTH)]),
        (
            [(1, 0, 29, 0.0), (2, 0, 29, 4.0), (1, 30, STEPS - 1, 4.0), (2, 30, STEPS - 1, 0.0)],
            None,
            [(why.SWITCH, why.ASSOCIATION)] * 2,
        ),
        ([(1, 0, 19, 0.0), ON_NOTHING, NEW, TWO], (20, 33), [(why.SWITCH, why.REIDENTIFICATION)]),
        ([(1, 0, 25, 0.0), NEW, TWO], (20, 33), [(why.LOSS, why.DEATH), (why.SWITCH, why.DEATH)]),
    ],
    ids=["ends beside another", "born beside a living one", "change places", "comes back", "ends while hidden"],
)
def test_each_failure_has_the_cause_that_the_tracks_show(tracks, unseen, told):
    assert [(each.kind, each.cause) for each in scene(tracks, unseen)] == told


def test_the_table_sums_to_the_total_and_links_to_the_moment():
    rng = np.random.default_rng(1)
    found = scene([(int(number), 6 * place, 6 * place + 5, 0.0) for place, number in enumerate(rng.permutation(10))])
    counts = why.counted(found)
    assert sum(sum(of_kind.values()) for of_kind in counts.values()) == len(found)
    assert why.Why(tuple(found), (), "results/a b", "b").counts()["a"] == counts
    moment = why.moment_of(why.TrackFailure(why.SWITCH, why.DEATH, "flow 3.4", 3.1, 1, 2))
    assert moment == "#t=2.1&vehicle=flow%203.4"
