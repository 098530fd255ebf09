import numpy as np
import pandas as pd
import pytest
from scipy.stats import beta

from harness.analysis.mismatch_cost import STOPPED_NOTE, costs, costs_markdown, leads
from harness.commands.from_options import with_values
from harness.commands.stress import command
from harness.common.errors import InputError
from harness.config.options import checked
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.options import GridOptions
from harness.grid.request import request_of
from harness.grid.worlds import altered_worlds, chosen_worlds, usual_worlds
from harness.running.open import open_snapshots
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.sensor.profiles import sensor_settings
from harness.storage.schema import AS_IS


def test_every_tracker_runs_under_every_mismatch_on_shared_detections():
    grid = plan_grid(GridRequest(densities="20", seeds="2", trackers="mmpf,stonesoup-jpda", mismatch=True))
    assert len(grid.cells) == 2 * 7
    assert len({run.key for run in grid.runs}) == 2 * 7 * 2
    for cell in grid.cells:
        assert len({run.mismatch for run in cell.runs}) == 1
        assert cell.runs[0].config.sensor == cell.runs[1].config.sensor
        assert cell.runs[0].config.tracker.believes == cell.runs[1].config.tracker.believes


def test_five_times_the_clutter_is_five_times_that_of_the_profile():
    sensor = sensor_settings("lidar", {})
    words = dict(word.split("=") for word in usual_worlds(sensor)["clutter x 5"])
    assert float(words["sensor.clutter_per_scan"]) == pytest.approx(5 * sensor.clutter_per_scan)
    assert float(words["sensor.persistent_clutter"]) == pytest.approx(5 * sensor.persistent_clutter)


def run_of(name, density, seed, hota, world=AS_IS):
    where = {"variant": name, "model": None, "density": density, "seed": seed, "mismatch": world}
    return where | {"mot.hota": hota, "succeeded": True}


def test_losses_are_paired_run_by_run_and_two_densities_of_a_seed_are_one_unit():
    rows = [
        run_of("a", density, seed, hota, mismatch) | {"mot.id_switches": 3.0, "calibration.coverage95.lon": 95.0}
        for mismatch, values in ((AS_IS, (90.0, 60.0, 80.0)), ("bursts", (88.0, 57.0, 76.0)))
        for seed, hota in enumerate(values)
        for density in (20.0, 45.0)
    ]
    usual, bursts = costs(pd.DataFrame(rows))
    assert usual.hota_loss == 0.0
    assert bursts.hota_loss == pytest.approx(np.mean([2.0, 3.0, 4.0]))
    low, high = bursts.hota_loss_ci95
    # Three seeds with a standard deviation of 1: 4.303 standard errors of 1 / sqrt(3) to either side.
    assert (low, high) == pytest.approx((3.0 - 4.303 / 3**0.5, 3.0 + 4.303 / 3**0.5), abs=1e-3)
    # HOTA of 88, 57 and 76: a mean of 73.67, a standard deviation of 15.63. As a share it is that of so many samples:
    samples = 0.7367 * 0.2633 / (0.1563**2 / 3) * (1.960 / 4.303) ** 2
    ends = [100 * beta.ppf(at, 0.7367 * samples + up, 0.2633 * samples + 1 - up) for at, up in ((0.025, 0), (0.975, 1))]
    assert bursts.hota_ci95 == pytest.approx(ends, abs=0.05)
    assert f"| a | bursts | 73.7 [{ends[0]:.1f}, {ends[1]:.1f}] | 3.0 [" in costs_markdown([usual, bursts], [])


def test_a_tracker_without_runs_at_the_hard_density_is_not_the_best_of_the_others():
    hota = {"first": (90.0, 70.0), "second": (88.0, 69.0), "third": (89.0, None)}
    rows = [run_of(name, at, seed, of[at > 20]) for name, of in hota.items() for at in (20, 45) for seed in (0, 1)]
    (told,) = leads(pd.DataFrame(rows))
    assert (told.best_other, told.ahead, told.runs) == ("second", 1.5, 4)


def test_the_first_tracker_is_held_against_the_best_of_the_others_in_each_world():
    hota = {
        "first": {AS_IS: (90.0, 80.0), "posts": (70.0, 60.0)},
        "second": {AS_IS: (82.5, 73.5), "posts": (75.0, 69.0)},
        "third": {AS_IS: (85.0, 70.0), "posts": (60.0, 60.0)},
    }
    rows = [
        {"variant": tracker, "model": None, "density": 20.0, "seed": seed, "mismatch": world, "succeeded": True}
        | {"mot.hota": value, "in_plain_view.worst_tenth": 100.0 - value, "traffic.flow_veh_per_h": value}
        for tracker, by_world in hota.items()
        for world, values in by_world.items()
        for seed, value in enumerate(values)
    ]
    usual, posts, in_view, _ = leads(pd.DataFrame(rows))
    assert (usual.mismatch, usual.first, usual.best_other, usual.runs) == (AS_IS, "first", "second", 2)
    assert (usual.ahead, posts.ahead, posts.best_other) == (7.0, -7.0, "second")
    # Differences of 7.5 and 6.5: 12.706 standard errors of 0.5 to either side.
    assert usual.ahead_ci95 == pytest.approx((7.0 - 12.706 * 0.5, 7.0 + 12.706 * 0.5), abs=1e-2)
    scattered = [row | ({"mot.hota": 20.0} if row["variant"] != "first" and row["seed"] else {}) for row in rows]
    assert np.isnan(leads(pd.DataFrame(scattered))[0].ahead_ci95).all(), "two seeds would tell of 381 points"
    assert (in_view.score, in_view.best_other, in_view.ahead) == ("worst tenth", "third", -7.5)
    page = costs_markdown(costs(pd.DataFrame(rows)), [], [usual])
    assert "| as is | HOTA | first | second | 7.0 [0.6, 13.4] | 2 |" in page
    assert leads(pd.DataFrame(rows[:4])) == []
    assert {lead.mismatch for lead in leads(pd.DataFrame(rows[:2] + rows[4:]))} == {AS_IS}  # the first has no "posts"


@pytest.mark.parametrize("stopped", [(80.0, 90.0), ()])
def test_stopped_vehicles_are_told_of_where_there_are_some(stopped):
    table = pd.DataFrame(
        {"variant": tracker, "model": None, "density": 10.0, "seed": 0, "mismatch": AS_IS, "mot.hota": 80.0}
        | {"succeeded": True, "in_plain_view.stopped_recall": recall}
        for tracker, recall in zip(("first", "second"), stopped or (None, None), strict=True)
    )
    ahead = [(lead.best_other, lead.ahead) for lead in leads(table) if lead.score == "stopped amid traffic"]
    assert ahead == ([("second", -10.0)] if stopped else [])
    page = costs_markdown(costs(table), [])
    assert {words in page for words in ("stopped amid traffic", "80.0 %", STOPPED_NOTE)} == {bool(stopped)}


def test_worlds_are_chosen_by_name_and_as_is_comes_first():
    sensor = sensor_settings("lidar", {})
    chosen = chosen_worlds("posts, clutter x 5,dark", sensor, of_finished=False)
    assert list(chosen) == [AS_IS, "posts", "clutter x 5", "dark"]
    assert list(chosen_worlds("clutter-x-5", sensor, of_finished=False)) == [AS_IS, "clutter x 5"]
    assert chosen_worlds(None, sensor, of_finished=False) == usual_worlds(sensor)
    assert set(chosen_worlds("all", sensor, of_finished=False)) >= set(altered_worlds(sensor))
    with pytest.raises(InputError, match=r"`mismatch` 'post': no such world; did you mean posts\?"):
        chosen_worlds("post", sensor, of_finished=False)


def test_no_world_of_finished_runs_simulates_the_sensor_anew():
    sensor = sensor_settings("lidar", {})
    for asked in (None, "all"):
        for words in chosen_worlds(asked, sensor, of_finished=True).values():
            assert not any(word.startswith("sensor.") for word in words)
    with pytest.raises(InputError, match="noise-correlated: it needs a new sensor simulation"):
        chosen_worlds("noise-correlated", sensor, of_finished=True)


def test_the_settings_of_every_world_are_known_and_change_something():
    sensor = sensor_settings("lidar", {})
    for name, words in altered_worlds(sensor).items():
        config = resolve_run_config(None, {}, list(words))
        assert config != resolve_run_config(None, {}, []), name


@pytest.mark.slow
def test_finished_runs_are_planned_with_their_own_ego_and_altered_detections(tmp_path):
    folder = tmp_path / "finished"
    run(resolve_run_config(None, {"density": 10.0, "duration": 0.5, "tracker": "detections"}, []), out=folder)
    grid = plan_grid(
        GridRequest(net=None, seeds="1", trackers="detections", replay=(str(folder),), mismatch="fewer,none-false")
    )
    assert [cell.runs[0].mismatch for cell in grid.cells] == [AS_IS, "fewer", "none-false"]
    as_is, fewer, none_false = (list(open_snapshots(cell.config)) for cell in grid.cells)
    for usual, less, clean in zip(as_is, fewer, none_false, strict=True):
        names = usual.observation.truth_id
        assert set(less.observation.truth_id) <= set(names)
        assert (clean.observation.truth_id == names[names != ""]).all()
    assert sum(len(snapshot.observation.truth_id) for snapshot in fewer) < sum(
        len(snapshot.observation.truth_id) for snapshot in as_is
    )
    with pytest.raises(InputError, match="`mismatch`: give finished runs or files of recorded traffic"):
        plan_grid(GridRequest(net=None, seeds="1", replay=(str(folder), __file__), mismatch="fewer"))


def test_the_flag_alone_asks_for_the_usual_worlds():
    typed = ["stress", "--mismatch", "--trackers", "pmbm", "--mismatch"]
    assert with_values(command, typed) == ["stress", "--mismatch", "usual", "--trackers", "pmbm", "--mismatch", "usual"]
    assert with_values(command, ["stress", "--mismatch", "posts"]) == ["stress", "--mismatch", "posts"]
    assert with_values(command, ["stress", "--mismatch=posts", "-x"]) == ["stress", "--mismatch=posts", "-x"]
    for asked in (True, "usual"):
        assert request_of(checked(GridOptions, {"mismatch": asked}, "stress")).mismatch is True
    assert request_of(checked(GridOptions, {"mismatch": ["posts", "dark"]}, "stress")).mismatch == "posts,dark"
    assert request_of(checked(GridOptions, {}, "stress")).mismatch is False
