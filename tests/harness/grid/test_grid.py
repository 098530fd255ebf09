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


def test_a_label_names_a_tracker_with_its_settings():
    grid = plan_grid(GridRequest(densities="20", seeds="1", trackers="pmbm,calm=pmbm+lon_noise=1.5"))
    assert [run.variant for run in grid.runs] == ["pmbm", "calm"]
    assert [run.config.tracker.options for run in grid.runs] == [{}, {"lon_noise": 1.5}]
    assert "- calm: `pmbm+lon_noise=1.5`" in labels_markdown(grid)
