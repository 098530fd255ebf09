"""What a closed loop tells, from tables of rows that are made up."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from harness.closedloop import summary
from harness.closedloop.plan import BRAKE, CROSS, FREE, KIND
from harness.scoring.metrics.closedloop import (
    COLLIDED,
    ENDED,
    HARD_BRAKES,
    IMPACT,
    IN_TIME,
    KM,
    NO_CANDIDATE,
    QUANTITIES,
    TTC,
)

CROSSED = "drive.crossed_percent"
OF_DRIVING = [quantity for quantity in QUANTITIES if quantity.key != IMPACT and "cross" not in quantity.key]


def table_of(seeds=6, beliefs=("truth", "mmpf"), kinds=(FREE, BRAKE)):
    rng = np.random.default_rng(1)
    rows = [
        {"seed": seed, KIND: kind, "variant": belief, "succeeded": True, "error": None, ENDED: IN_TIME}
        | {quantity.key: float(rng.uniform(0.0, 5.0)) for quantity in OF_DRIVING}
        | {COLLIDED: 0.0, IMPACT: np.nan, "episode.looked_through": 3.0, KM: float(rng.uniform(0.05, 0.4))}
        for seed in range(seeds)
        for kind in kinds
        for belief in beliefs
    ]
    return pd.DataFrame(rows)


@cache
def usual_scores():
    return summary.scores(table_of())


def one(found, belief, metric, episodes=summary.ALL):
    return next(score for score in found if (score.belief, score.metric, score.episodes) == (belief, metric, episodes))


def test_the_truth_is_in_excess_of_itself_by_nothing():
    found = usual_scores()
    for score in [each for each in found if each.belief == "truth"]:
        assert score.excess in (0.0, None)
        assert score.excess_ci95 in ((0.0, 0.0), None)


def test_hard_brakes_a_kilometre_are_all_brakes_over_all_kilometres_of_a_belief_and_of_the_truth():
    table = table_of(seeds=20)
    sums = table.assign(brakes=table[HARD_BRAKES] * table[KM]).groupby("variant")[["brakes", KM]].sum()
    rate = sums["brakes"] / sums[KM]
    score = one(summary.scores(table), "mmpf", HARD_BRAKES)
    assert score.mean == pytest.approx(rate["mmpf"])
    assert score.excess == pytest.approx(rate["mmpf"] - rate["truth"])
    assert score.ci95[0] < score.mean < score.ci95[1]
    assert score.excess_ci95[0] < score.excess < score.excess_ci95[1]


def test_an_excess_is_the_mean_of_pairs_with_students_interval_over_seeds():
    table = table_of(kinds=(FREE,))
    by = table.pivot_table(index="seed", columns="variant", values=TTC)
    difference = (by["mmpf"] - by["truth"]).to_numpy()
    score = one(summary.scores(table), "mmpf", TTC)
    assert score.excess == pytest.approx(difference.mean())
    expected = stats.t.interval(0.95, 5, difference.mean(), stats.sem(difference))
    # Nobody can be below 1.5 s for less than no time.
    assert expected[0] < -by["truth"].mean()
    assert score.excess_ci95 == pytest.approx((-by["truth"].mean(), expected[1]))


def test_six_episodes_without_a_collision_are_no_certainty():
    table = table_of(kinds=(FREE,)).assign(**{COLLIDED: 0.0})
    score = one(summary.scores(table), "mmpf", COLLIDED)
    assert (score.mean, score.ci95[0], score.excess, score.excess_ci95) == (0.0, 0.0, 0.0, None)
    # Six independent episodes.
    assert score.ci95[1] == pytest.approx(100.0 * (1.0 - 0.025 ** (1.0 / 6.0)))


def test_the_answer_names_collisions_and_what_came_close_to_one():
    table = table_of(kinds=(FREE,)).assign(**{TTC: 0.25})
    text = summary.as_markdown("t", summary.scores(table), table, [])
    assert "0 of 6 episodes end in a collision; time to collision below 1.5 s for 0.25 % of the time" in text


@pytest.mark.slow
def test_provoked_episodes_are_told_apart_and_those_without_a_candidate_are_left_out():
    table = table_of()
    table.loc[(table["seed"] == 0) & (table[KIND] == BRAKE), ENDED] = NO_CANDIDATE
    found = summary.scores(table)
    groups = (summary.ALL, summary.FREE_ONES, summary.PROVOKED_ONES)
    assert [one(found, "mmpf", TTC, name).n for name in groups] == [11, 6, 5]
    assert "1 more have no candidate" in summary.as_markdown("t", found, table, [])


@pytest.mark.slow
def test_scores_of_some_episodes_are_told_of_these_and_each_provocation_apart():
    table = table_of(kinds=(FREE, BRAKE, CROSS))
    needs = table[KIND] == CROSS
    table.loc[needs, CROSSED] = np.where(table["variant"][needs] == "truth", 100.0, 0.0)
    found = summary.scores(table)
    assert (one(found, "truth", CROSSED).n, one(found, "truth", CROSSED).mean) == (6, 100.0)
    assert one(found, "mmpf", CROSSED, CROSS).excess == -100.0
    assert not [score for score in found if score.metric == CROSSED and score.episodes in (summary.FREE_ONES, BRAKE)]
    assert "*Waiting* is" in summary.as_markdown("t", found, table, [])
    assert not [score for score in usual_scores() if score.episodes in (BRAKE, CROSS) or score.metric == CROSSED]


@pytest.mark.slow
def test_cars_that_had_been_in_sight_and_those_that_never_were_are_told_apart():
    table = table_of(kinds=(FREE, CROSS))
    table["episode.seen_before"] = np.where(table[KIND] == CROSS, (table["seed"] < 2).astype(float), np.nan)
    found = summary.scores(table)
    assert [one(found, "mmpf", TTC, name).n for name in (summary.SEEN_BEFORE, summary.NEVER_SEEN)] == [2, 4]
    assert "*cross*" in summary.as_markdown("t", found, table, [])
    only = summary.scores(table[table["seed"] < 2])
    assert not [score for score in only if score.episodes in (summary.SEEN_BEFORE, summary.NEVER_SEEN)]


def test_where_every_drive_failed_there_are_no_scores_and_the_failures_are_told():
    table = table_of()[["seed", KIND, "variant", "error"]].assign(succeeded=False)
    assert not summary.scores(table)
    assert "- a: failed" in summary.as_markdown("t", [], table, ["a: failed"])


@pytest.mark.slow
def test_collisions_are_listed_the_hardest_first_with_their_replays():
    table = table_of().assign(replay="")
    for row, impact in ((3, 2.0), (5, 7.0)):
        table.loc[row, [COLLIDED, IMPACT]] = 100.0, impact
        table.loc[row, "drive.collision_time_s"] = 4.0
        table.loc[row, "drive.collided_with"] = f"car{row}"
        table.loc[row, "replay"] = f"kept/{row}/report.html"
    text = summary.as_markdown("t", summary.scores(table), table, ["a: failed"])
    assert text.index("kept/5/report.html") < text.index("kept/3/report.html")
    assert "- a: failed" in text
