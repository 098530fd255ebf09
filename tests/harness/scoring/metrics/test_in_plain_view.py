"""Who has a track in plain view: tiny scenes with known answers, and plain loops over a lively run."""

import numpy as np
import pytest

from harness.scoring.metrics.in_plain_view import worst_share
from harness.scoring.score import RunScorer
from tests.harness.scoring.scenes import STEP_S, Scene, score_run, traffic

STEPS = 40
# Half a second of the four in plain view is not asked for.
ASKED = STEPS - 5


def scores(scene):
    return score_run(*scene.tables()).metrics["in_plain_view"]


def speeds(scene, name, speed):
    """Give a vehicle of a scene a speed."""
    for table in scene.truth:
        if table["vehicle_id"].iloc[0] == name:
            table["speed_mps"] = speed
    return scene


def test_a_car_that_was_never_detected_counts_in_full():
    found = scores(Scene(STEPS).vehicle("dark", lon=40.0).vehicle("bright", lon=20.0, detected=True).track(1, 20.0))
    assert found["n"] == 2 * ASKED
    assert found["recall"] == pytest.approx(50.0)
    assert found["worst_tenth"] == 0.0
    assert (found["never_reported"], found["dropped"]) == (1, 0)
    assert found["vehicles"] == [
        {
            "id": "dark", "kind": "never reported", "episode": 0, "from_s": 0.0, "to_s": pytest.approx(3.9),
            "closest_m": 40.0, "without_track_s": pytest.approx(4.0), "detected_percent": 0.0,
        }
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("told", "recall"), [({"state": "hidden"}, 100.0), ({"state": "tentative"}, 0.0), ({"lon": 44.1}, 0.0)]
)
def test_a_track_counts_that_is_reported_and_within_the_gate(told, recall):
    scene = Scene(STEPS).vehicle("car", lon=40.0)
    assert scores(scene.track(1, **({"lon": 40.0} | told)))["recall"] == recall


def test_one_track_serves_one_vehicle():
    scene = Scene(STEPS).vehicle("a", lon=40.0).vehicle("b", lon=43.0).track(1, 41.0)
    assert scores(scene)["recall"] == pytest.approx(50.0)
    assert scores(scene.track(2, 46.0))["recall"] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("where", "asked"),
    [
        ({"lon": 61.0}, 0),
        ({"lon": 60.0}, ASKED),
        ({"lon": 40.0, "state": "partial"}, 0),
        ({"lon": 40.0, "state": "out"}, 0),
        # Half a second more after each interruption.
        ({"lon": 40.0, "state": np.where(np.arange(STEPS) == 20, "partial", "visible")}, 15 + 14),
        # In plain view since long before it came near.
        ({"lon": np.where(np.arange(STEPS) < 30, 80.0, 50.0)}, 10),
    ],
)  # fmt: skip
def test_asked_for_is_who_has_been_in_plain_view_for_half_a_second_and_is_near(where, asked):
    found = scores(Scene(STEPS).vehicle("car", **where))
    assert found["n"] == asked
    assert found["recall"] == (0.0 if asked else None)


def test_the_time_to_the_first_report_is_time_in_plain_view_and_all_of_it_without_one():
    gap = np.where((np.arange(STEPS) >= 5) & (np.arange(STEPS) < 15), "hidden", "visible")
    scene = Scene(STEPS).vehicle("late", lon=20.0, state=gap).track(1, 20.0, at=np.arange(18, STEPS))
    # Five steps before it was hidden, and three afterwards.
    assert scores(scene)["median_first_report_s"] == pytest.approx(0.8)
    scene.vehicle("never", lon=50.0)
    both = scores(scene)
    assert both["median_first_report_s"] == pytest.approx((0.8 + 4.0) / 2.0)
    assert both["p90_first_report_s"] == pytest.approx(0.8 + 0.9 * (4.0 - 0.8))
    assert both["vehicles_n"] == 2


@pytest.mark.parametrize(("without", "dropped"), [((20, 25), 1), ((20, 24), 0), ((35, STEPS), 1), ((0, 20), 0)])
def test_dropped_is_who_stays_in_plain_view_for_half_a_second_after_its_track_ends(without, dropped):
    kept = np.array([step for step in range(STEPS) if not without[0] <= step < without[1]])
    found = scores(Scene(STEPS).vehicle("car", lon=30.0, detected=np.arange(STEPS) % 5 == 0).track(1, 30.0, at=kept))
    assert (found["dropped"], found["never_reported"]) == (dropped, 0)
    if dropped:
        (entry,) = found["vehicles"]
        assert (entry["id"], entry["kind"], entry["detected_percent"]) == ("car", "dropped", 20.0)
        assert (entry["from_s"], entry["to_s"]) == pytest.approx((0.1 * without[0], 0.1 * (without[1] - 1)))
        assert entry["without_track_s"] == pytest.approx(0.5)


def test_who_goes_out_of_plain_view_with_its_track_is_not_dropped():
    hidden = np.where(np.arange(STEPS) < 20, "visible", "hidden")
    found = scores(Scene(STEPS).vehicle("car", lon=30.0, state=hidden).track(1, 30.0, at=np.arange(20)))
    assert (found["dropped"], found["vehicles"]) == (0, [])


def test_who_was_in_plain_view_for_less_than_a_second_is_never_called_never_reported():
    for steps, never in ((9, 0), (10, 1)):
        state = np.where(np.arange(STEPS) < steps, "visible", "hidden")
        assert scores(Scene(STEPS).vehicle("car", lon=30.0, state=state))["never_reported"] == never


def test_the_worst_come_first_and_at_most_twenty_are_listed():
    scene = Scene(STEPS)
    for k in range(24):
        scene.vehicle(f"car{k}", lon=-50.0 + 4.0 * k, at=np.arange(k, STEPS))
    found = scores(scene)
    assert found["never_reported"] == 24
    assert [entry["id"] for entry in found["vehicles"]] == [f"car{k}" for k in range(20)]


def test_stopped_recall_is_of_who_stands_for_two_seconds_while_the_others_drive():
    scene = Scene(STEPS).vehicle("broken", lon=30.0).vehicle("flows", lon=10.0).track(1, 30.0, at=np.arange(30))
    assert scores(scene)["stopped_recall"] is None
    speeds(scene, "broken", 0.4)
    found = scores(scene)
    assert found["stopped_n"] == STEPS - 20
    assert found["stopped_recall"] == pytest.approx(50.0)
    assert scores(speeds(scene, "flows", 4.9))["stopped_n"] == 0
    alone = speeds(Scene(STEPS).vehicle("broken", lon=30.0), "broken", 0.0)
    assert scores(alone)["stopped_n"] == 0


def test_the_worst_tenth_is_one_vehicle_at_least_and_of_equal_vehicles_the_longer_one_is_worse():
    counted = np.array([10, 30, 20, 50, 5, 0])
    followed = np.array([5, 15, 20, 50, 0, 0])
    chosen = counted >= 10
    assert worst_share(counted, followed, chosen, 0.1).tolist() == [1]
    assert worst_share(counted, followed, chosen, 0.5).tolist() == [1, 0]
    assert worst_share(counted, followed, chosen, 0.8).tolist() == [1, 0, 3]
    many = np.arange(20) + 10
    assert worst_share(np.full(20, 40), many, np.ones(20, dtype=bool), 0.1).tolist() == [0, 1]
    assert worst_share(np.full(19, 40), many[:19], np.ones(19, dtype=bool), 0.1).tolist() == [0]
    assert worst_share(counted, followed, np.zeros(6, dtype=bool), 0.1).tolist() == []


def test_nothing_to_ask_for_is_none():
    found = scores(Scene(STEPS))
    assert (found["recall"], found["worst_tenth"], found["median_first_report_s"]) == (None, None, None)
    assert (found["n"], found["never_reported"], found["dropped"], found["vehicles"]) == (0, 0, 0, [])


def by_plain_loops(truth, tracks):
    """Return recall, worst tenth, drops and never reported of traffic that is too sparse for rivals within a gate."""
    reported = tracks[tracks["state"] != "tentative"]
    places = {step: rows[["lon_m", "lat_m"]].to_numpy() for step, rows in reported.groupby("step")}
    egos = truth[truth["is_ego"]].set_index("step")
    asked, held, drops, never = [], [], 0, 0
    for _, rows in truth[~truth["is_ego"]].sort_values("step").groupby("vehicle_id"):
        in_view, lost, has_had, view, mine, of_mine, ever = 0, 0, False, 0, 0, 0, False
        for row in rows.itertuples():
            ego = egos.loc[row.step]
            near = np.hypot(row.lon_m - ego["lon_m"], row.lat_m - ego["lat_m"]) <= 60.0
            in_view = in_view + 1 if row.state == "visible" and row.in_range else 0
            if not in_view or not near:
                lost, has_had = 0, False
                continue
            view += 1
            off = np.abs(places.get(row.step, np.zeros((0, 2))) - [row.lon_m, row.lat_m])
            has = bool(((off[:, 0] <= 4.0) & (off[:, 1] <= 2.0)).any())
            ever |= has
            if in_view > 5:
                mine, of_mine = mine + 1, of_mine + has
            lost = 0 if has else lost + 1
            has_had |= has
            drops += has_had and lost == 5
        never += view >= 10 and not ever
        asked.append(mine)
        held.append(of_mine)
    asked, held = np.array(asked), np.array(held)
    ranked = sorted((held[k] / asked[k], -asked[k]) for k in np.flatnonzero(asked >= 10))
    worst = ranked[: max(1, len(ranked) // 10)]
    tenth = sum(share * -steps for share, steps in worst) / sum(-steps for _, steps in worst)
    return held.sum() / asked.sum(), tenth, drops, never


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_lively_run_has_the_scores_of_plain_loops(seed):
    truth, detections, tracks = traffic(steps=150, vehicles=25, seed=seed)
    number = truth["vehicle_id"].str.removeprefix("car").astype(int)
    # Far enough apart for a gate to hold one vehicle alone, and one vehicle in nine without any track.
    truth["lon_m"] = 12.0 * (number % 9) + 10.0 * truth["time_s"]
    truth["lat_m"] = 8.0 * (number // 9)
    places = truth.set_index(["step", "vehicle_id"])
    rng = np.random.default_rng(seed)
    kept = []
    for k in range(1, 25):
        if k % 9 == 4:
            continue
        own = places.xs(f"car{k}", level=1)
        alive = np.repeat(rng.random(15) < 0.8, 10)
        kept += [
            {"step": s, "time_s": STEP_S * s, "track_id": 100 * k + s // 40, "lon_m": row["lon_m"] + rng.normal(0, 1.5),
             "lat_m": row["lat_m"], "state": "tentative" if rng.random() < 0.1 else "confirmed"}
            for (s, row), lives in zip(own.iterrows(), alive, strict=True) if lives
        ]  # fmt: skip
    table = tracks.iloc[:0].drop(columns=["step", "time_s", "track_id", "lon_m", "lat_m", "state"])
    made = table.reindex(range(len(kept))).assign(**{key: [each[key] for each in kept] for key in kept[0]})
    made = made.fillna({"speed_mps": 10.0, "lat_speed_mps": 0.0, "existence": 0.9}).fillna(1.0)
    found = score_run(truth, detections, made).metrics["in_plain_view"]
    recall, tenth, drops, never = by_plain_loops(truth, made)
    assert 0.3 < recall < 0.95
    assert drops > 3
    assert never > 0
    assert found["recall"] == pytest.approx(100.0 * recall)
    assert found["worst_tenth"] == pytest.approx(100.0 * tenth)
    assert (found["dropped"], found["never_reported"]) == (drops, never)


def test_the_same_name_in_another_stretch_is_another_vehicle():
    truth, detections, tracks = Scene(STEPS).vehicle("dark", lon=40.0).tables()
    later = [table.assign(step=table["step"] + STEPS, time_s=table["time_s"] + STEP_S * STEPS) for table in
             (truth.assign(episode=1), detections, tracks)]  # fmt: skip
    scorer = RunScorer()
    scorer.add(truth, detections, tracks)
    scorer.add(*later)
    found = scorer.metrics()["in_plain_view"]
    assert (found["never_reported"], found["n"]) == (2, 2 * ASKED)
    assert [(entry["id"], entry["episode"]) for entry in found["vehicles"]] == [("dark", 0), ("dark", 1)]
