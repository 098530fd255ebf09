"""Several networks in one grid: each at its own middle density, and scores by network."""

import json

import numpy as np
import pandas as pd
import pytest

from harness.analysis.curves import breaks, curve_points
from harness.analysis.tables import as_markdown
from harness.api import Grid, compare
from harness.config.options import checked
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.options import GridOptions
from harness.grid.request import request_of
from harness.grid.stress import run_stress
from harness.report.folder_page import folder_page
from harness.storage.schema import NET
from tests.harness.analysis.test_curves import rows
from tests.harness.grid.executors import ECHO, STEADY, InProcess

SMALL = GridRequest(net=None, nets="curve,junction", seeds="2", trackers=ECHO, duration_s=1.0)


def asked(**options) -> GridRequest:
    return request_of(checked(GridOptions, options, "stress"))


def demands(request: GridRequest) -> list[tuple]:
    traffic = [cell.config.traffic for cell in plan_grid(request).cells]
    return [(each.net, each.demand, each.density) for each in traffic]


def test_each_network_is_driven_at_its_own_middle_density():
    assert demands(asked(nets=["us101", "junction"], seeds=1)) == [
        ("us101", "us101-0805", None),
        ("junction", "middle", None),
    ]


def test_densities_or_demands_that_are_given_hold_for_every_network():
    assert demands(asked(nets="curve,priority", densities="10,20", seeds=1)) == [
        ("curve", None, 10.0), ("curve", None, 20.0), ("priority", None, 10.0), ("priority", None, 20.0),
    ]  # fmt: skip
    named = demands(asked(nets="curve,priority", demands=["light", "heavy"], seeds=1))
    assert [demand for _, demand, _ in named] == ["light", "heavy"] * 2


def two_networks() -> pd.DataFrame:
    table = [
        {**rows(20, seed, same_id=share), NET: net, "density": None, "demand": "middle"}
        for net, share in (("curve", 40), ("junction", 60))
        for seed in range(3)
    ]
    return pd.DataFrame(table)


def test_each_tracker_has_one_row_for_each_network():
    points = [point for point in curve_points(two_networks(), ()) if point.metric == "occlusion.same_id"]
    assert [(point.axis, point.label, point.value, point.mean) for point in points] == [
        (NET, "mmpf cvm", "curve", 40.0), (NET, "mmpf cvm", "junction", 60.0),
    ]  # fmt: skip


def test_over_densities_no_mean_is_taken_over_networks():
    table = pd.DataFrame([
        {**rows(density, seed, same_id=share), NET: net}
        for net, shares in (("curve", (90, 20)), ("junction", (80, 60)))
        for density, share in zip((10, 20), shares, strict=True)
        for seed in range(3)
    ])  # fmt: skip
    points = [point for point in curve_points(table, ()) if point.metric == "occlusion.same_id"]
    assert {(point.label, point.value): point.mean for point in points if point.axis == "density"} == {
        ("mmpf cvm, curve", 10.0): 90.0, ("mmpf cvm, curve", 20.0): 20.0,
        ("mmpf cvm, junction", 10.0): 80.0, ("mmpf cvm, junction", 20.0): 60.0,
    }  # fmt: skip
    assert [(each.label, each.density is None) for each in breaks(table)] == [
        ("mmpf cvm, curve", False), ("mmpf cvm, junction", True),
    ]  # fmt: skip


def open_others(config):
    """Open stand-in traffic; there is none for seed 1 on the junction."""
    if (config.traffic.net, config.seed) == ("junction", 1):
        raise OSError("nothing drives there")
    return STEADY(config)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("nets") / "grid"
    run_stress(SMALL, folder, InProcess(open_others))
    return folder


@pytest.mark.slow
def test_the_table_the_figure_and_the_page_tell_scores_by_network(finished):
    text = (finished / "table.md").read_text()
    assert text.startswith("# Stress test on curve, junction")
    assert "## By network" in text
    assert "| tracker | network |" in text
    assert (finished / "figures" / "over_net.png").stat().st_size > 10_000
    summary = json.loads((finished / "summary.json").read_text())
    assert {point["value"] for point in summary["curves"]} == {"curve", "junction"}
    page = folder_page(finished)
    assert "By network" in page
    assert "junction, middle" in page


@pytest.mark.slow
def test_a_failed_cell_of_one_network_is_told_and_in_no_mean(finished):
    text = (finished / "table.md").read_text()
    assert "net junction, demand middle" in text.partition("## Runs that failed")[2]
    points = json.loads((finished / "summary.json").read_text())["curves"]
    assert {(point["value"], point["seeds"]) for point in points if point["metric"] == "timing.tracker_ms.p50"} == {
        ("curve", 2), ("junction", 1),
    }  # fmt: skip


@pytest.mark.slow
def test_two_such_grids_are_compared_network_by_network(finished, tmp_path):
    other = tmp_path / "other"
    run_stress(GridRequest(**{**SMALL.as_table(), "nets": "junction,curve"}), other, InProcess(open_others))
    compared = compare(Grid(finished), Grid(other))
    judged = compared.verdicts[compared.verdicts["metric"] == "mot.hota"]
    # Two seeds on the curve and one on the junction, each with itself.
    assert list(judged["pairs"]) == [3]
    assert (judged["difference"] == 0.0).all()


def test_scores_by_manoeuvre_have_a_row_for_each_that_there_was():
    turning = {"manoeuvre.left.position_m": 0.5, "manoeuvre.left.n": 10.0, "manoeuvre.straight.same_id_percent": 90.0}
    table = pd.DataFrame([
        {**rows(20, 0, same_id=40), **turning, "manoeuvre.straight.events": 4.0, NET: "junction"},
        {**rows(20, 0, same_id=40), "manoeuvre.left.position_m": np.nan, NET: "curve"},
    ])  # fmt: skip
    text = as_markdown("a grid", curve_points(table, ()), [], [])
    lines = text[text.index("By what vehicles do") :].splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line]
    assert cells[0][:3] == ["tracker", "network", "vehicles"]
    assert sorted(cells[0][3:5]) == ["position error in sight, m", "same identity after occlusion, %"]
    told = [dict(zip(cells[0], row, strict=True)) for row in cells[2:]]
    assert [(row["network"], row["vehicles"]) for row in told] == [("junction", "straight"), ("junction", "left")]
    assert told[1]["position error in sight, m"] == "0.50"
    assert told[1]["same identity after occlusion, %"] == "-"
