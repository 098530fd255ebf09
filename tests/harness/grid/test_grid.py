"""From the user's lists to cells and runs."""

from harness.grid.cells import labels_markdown
from harness.grid.grid import GridRequest, plan_grid


def planned(**asked) -> list[dict]:
    return [run.identity() for run in plan_grid(GridRequest(**asked)).runs]


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


def test_a_label_names_a_tracker_with_its_settings():
    grid = plan_grid(GridRequest(densities="20", seeds="1", trackers="pmbm,calm=pmbm+lon_noise=1.5"))
    assert [run.variant for run in grid.runs] == ["pmbm", "calm"]
    assert [run.config.tracker.options for run in grid.runs] == [{}, {"lon_noise": 1.5}]
    assert "- calm: `pmbm+lon_noise=1.5`" in labels_markdown(grid)


def test_a_run_keeps_its_key_in_a_larger_grid():
    small = {run.key for run in plan_grid(GridRequest(densities="20", seeds="2")).runs}
    large = [run.key for run in plan_grid(GridRequest(densities="20,30", seeds="3")).runs]
    assert small < set(large)
    assert len(set(large)) == len(large) == 6


def test_anything_that_changes_a_run_changes_its_key():
    asked = [{}, {"duration_s": 5.0}, {"sensor": "radar"}, {"settings": ("sensor.range_m=80",)}, {"particles": 50}]
    keys = [plan_grid(GridRequest(densities="20", seeds="1", **each)).runs[0].key for each in asked]
    assert len(set(keys)) == len(keys)
