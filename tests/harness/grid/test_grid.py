"""From the user's lists to cells and runs."""

from __future__ import annotations

from harness.grid.grid import GridRequest, plan_grid


def planned(**asked) -> list[dict]:
    return [run.identity() for run in plan_grid(GridRequest(**asked)).runs]


def test_every_combination_is_run_once():
    runs = planned(densities="20,40", seeds="3", models="cvm,cam")
    assert len(runs) == len({tuple(run.items()) for run in runs}) == 12


def test_all_trackers_of_one_density_and_seed_share_a_cell():
    grid = plan_grid(GridRequest(densities="20,40", seeds="3", models="cvm,cam", trackers="mmpf,stonesoup-jpda"))
    assert len(grid.cells) == 6
    for cell in grid.cells:
        assert len({(run.config.traffic.density, run.config.seed) for run in cell.runs}) == 1
        assert [(run.config.tracker.name, run.config.tracker.model) for run in cell.runs] == [
            ("mmpf", "cvm"), ("mmpf", "cam"), ("stonesoup-jpda", None),
        ]  # fmt: skip


def test_models_go_with_mmpf_only_and_not_with_a_variant_that_names_its_own():
    runs = planned(densities="20", seeds="1", models="cvm,cam", trackers="mmpf+model=idm,mmpf,stonesoup-gnn")
    assert [(run["variant"], run["model"]) for run in runs] == [
        ("mmpf+model=idm", "idm"), ("mmpf", "cvm"), ("mmpf", "cam"), ("stonesoup-gnn", None),
    ]  # fmt: skip


def test_a_variant_sets_named_settings_and_options_of_its_tracker_alone():
    grid = plan_grid(
        GridRequest(
            densities="20", seeds="1", trackers="mmpf,mmpf+update=max_likelihood+max_likelihood.association.gate_std=4"
        )
    )
    plain, varied = (run.config.tracker for run in grid.runs)
    assert (plain.update, plain.options) == ("joint", {})
    assert (varied.update, varied.options) == ("max_likelihood", {"max_likelihood": {"association": {"gate_std": 4}}})


def test_a_varied_sensor_makes_new_cells_and_a_varied_tracker_does_not():
    sensor = plan_grid(GridRequest(densities="20", seeds="2", vary=("sensor.range_m=40:80:20",)))
    assert len(sensor.cells) == 6
    assert {run.config.sensor.overrides["range_m"] for run in sensor.runs} == {40, 60, 80}
    tracker = plan_grid(GridRequest(densities="20", seeds="2", vary=("tracker.particles=100,200",)))
    assert [len(cell.runs) for cell in tracker.cells] == [2, 2]
    assert {run.config.tracker.particles for run in tracker.runs} == {100, 200}


def test_tuned_trackers_are_untouched_by_settings_meant_for_mmpf():
    runs = planned(
        densities="20", seeds="1", trackers="mmpf,stonesoup-gnn", vary=("tracker.particles=100,200",), particles=50
    )
    assert [(run["tracker"], run.get("tracker.particles")) for run in runs] == [
        ("mmpf", 100), ("mmpf", 200), ("stonesoup-gnn", None),
    ]  # fmt: skip


def test_a_run_keeps_its_key_in_a_larger_grid():
    small = {run.key for run in plan_grid(GridRequest(densities="20", seeds="2")).runs}
    large = [run.key for run in plan_grid(GridRequest(densities="20,30", seeds="3")).runs]
    assert small < set(large)
    assert len(set(large)) == len(large) == 6


def test_anything_that_changes_a_run_changes_its_key():
    asked = [{}, {"duration_s": 5.0}, {"sensor": "radar"}, {"settings": ("sensor.range_m=80",)}, {"particles": 50}]
    keys = [plan_grid(GridRequest(densities="20", seeds="1", **each)).runs[0].key for each in asked]
    assert len(set(keys)) == len(keys)
