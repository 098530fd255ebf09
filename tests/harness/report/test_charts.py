import gzip
import html
import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.analysis.compare import Judgement
from harness.analysis.curve_charts import grid_charts
from harness.analysis.rules import Rules
from harness.analysis.verdicts import UNTESTED, WORSE, Verdict
from harness.common.charts import Charts, draw_charts
from harness.grid.grid import GridRequest, plan_grid
from harness.report.comparison_page import comparison_charts
from harness.report.page import LIBRARY
from harness.report.run_charts import diagnostics_charts, error_charts, visibility_charts

ROOT = Path(__file__).parents[3]


STATE_OF = {"visible": "visible", "partly hidden": "partial", "hidden": "hidden"}


REQUEST = GridRequest(densities="20,45", trackers="mmpf,stonesoup-jpda", seeds="2")


def grid_table():
    runs = plan_grid(REQUEST).runs
    rows = [run.identity() | {"succeeded": True, "mot.hota": 80.0 + place} for place, run in enumerate(runs)]
    return pd.DataFrame(rows)


def verdict(**changes):
    base = Verdict(
        "mmpf gmm", "hidden.hidden_cost_m", True, 2.0, 3.0, 1.0, (0.5, 1.5), 0.01, 10, 10.0, 0.04, WORSE, True
    )  # fmt: skip
    return replace(base, **changes)


def rows_of(chart):
    return chart.spec["data"]["values"]


def test_each_point_of_a_curve_is_a_mean_over_seeds_and_leads_to_the_cells_of_its_runs():
    table = grid_table()
    cells = [100 * int(row.density) + (row.variant == "mmpf") for row in table.itertuples()]
    (group,) = grid_charts(table, (), cells).values()
    chart = next(chart for chart in group.charts if chart.title == "HOTA in sight, %")
    assert len(rows_of(chart)) == 4
    for row in rows_of(chart):
        mine = (table["density"] == row["place"]) & (table["variant"] == row["series"].split()[0])
        assert row["mean"] == pytest.approx(table.loc[mine, "mot.hota"].mean())
        assert row["low"] < row["mean"] < row["high"]
        assert row["cells"] == sorted({cell for cell, chosen in zip(cells, mine, strict=True) if chosen})
    assert [name for name, _ in group.lines] == list(dict.fromkeys(row["series"] for row in rows_of(chart)))


def test_runs_that_no_cell_lists_lead_nowhere():
    table = grid_table()
    (group,) = grid_charts(table, (), [None] * len(table)).values()
    assert {tuple(row["cells"]) for chart in group.charts for row in rows_of(chart)} == {()}


def error_table():
    """Return errors of ten vehicles for three seconds; one of them is not followed, half are hidden after a second."""
    rng = np.random.default_rng(1)
    step, vehicle = (grid.ravel() for grid in np.meshgrid(np.arange(30), np.arange(10), indexing="ij"))
    columns = {name: rng.normal(size=300) for name in ("lon_error_m", "lat_error_m", "speed_error_mps")}
    return pd.DataFrame(
        {
            "time_s": np.round(0.1 * step, 1), "episode": 0, **columns,
            "state": np.where((vehicle < 5) & (step >= 10), "hidden", "visible"),
            "outcome": np.where(vehicle == 9, "lost", "tracked"),
        }
    )  # fmt: skip


def test_the_error_over_time_is_the_mean_of_what_is_followed_in_each_stretch():
    table = error_table()
    chart = error_charts(table).charts[0]
    followed = table[table["outcome"] == "tracked"]
    assert len(rows_of(chart)) == 15 + 10, "stretches of 0.2 s, those with hidden vehicles from the first second on"
    for row in rows_of(chart):
        since = followed["time_s"] - (row["place"] - 0.1)
        within = followed[(since > -1e-6) & (since < 0.2 - 1e-6) & (followed["state"] == STATE_OF[row["series"]])]
        assert row["mean"] == pytest.approx(np.abs(within["lon_error_m"]).mean())
        assert int(row["n"]) == len(within)


def test_bars_by_visibility_are_those_of_the_metrics(run):
    for key, chart in zip(("lon_m", "lat_m", "speed_mps"), visibility_charts(run.metrics["mae"]).charts, strict=True):
        for row in rows_of(chart):
            assert row["mean"] == run.metrics["mae"][STATE_OF[row["series"]]][key]


def test_better_is_to_the_right_whatever_a_metrics_direction():
    # The hidden cost grew by half: worse. HOTA grew by a tenth: better.
    hota = verdict(metric="mot.hota", a=80.0, b=88.0, difference=8.0, ci95=(4.0, 12.0), margin=1.6, verdict="better")
    chart = comparison_charts(Judgement("a", "b", (verdict(), hota), (), Rules())).charts[0]
    cost, score = rows_of(chart)
    assert (cost["change"], cost["low"], cost["high"]) == pytest.approx((-50.0, -75.0, -25.0))
    assert (score["change"], score["low"], score["high"]) == pytest.approx((10.0, 5.0, 15.0))
    assert (cost["below"], cost["tolerance"]) == pytest.approx((-2.0, 2.0))
    places = [layer["encoding"]["y"] for layer in chart.spec["layer"] if "y" in layer["encoding"]]
    assert all(place["scale"]["domain"] == [cost["metric"], score["metric"]] for place in places), "as in the table"
    assert cost["difference"] == "+1.000", "a value is told in its own unit and sign"


def test_what_is_not_judged_has_no_band_and_what_a_lacks_no_point():
    described = verdict(metric="mot.idf1", verdict=UNTESTED, primary=False)
    without = verdict(metric="hidden.false_hidden_tracks_per_scan", a=0.0)
    chart = comparison_charts(Judgement("a", "b", (described, without), (), Rules())).charts[0]
    assert [(row["metric"], row["tolerance"]) for row in rows_of(chart)] == [("IDF1 in sight, %", None)]
    assert comparison_charts(Judgement("a", "b", (without,), (), Rules())) is None


def test_the_committed_library_can_be_read_by_a_browser_and_stands_beside_its_licence():
    script = gzip.decompress(LIBRARY.read_bytes()).decode("utf-8")
    assert "window.vegaEmbed=" in script
    assert "</script" not in script
    assert "BSD-3-Clause" in (LIBRARY.parent / "LICENSE").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_committed_library_is_what_the_package_makes():
    spec = importlib.util.spec_from_file_location("vega_bundle", ROOT / ".ci" / "vega_bundle.py")
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    assert gzip.decompress(LIBRARY.read_bytes()).decode("utf-8") == maker.bundle()


def all_charts(run):
    comparison = Judgement("a", "b", (verdict(), verdict(metric="mot.hota")), (), Rules())
    table = grid_table()
    demands = table.assign(density=np.nan, demand=[f"d{place % 2}" for place in range(len(table))])
    return [
        *grid_charts(table, (), [1] * len(table)).values(), *grid_charts(demands, (), [1] * len(table)).values(),
        error_charts(error_table()), visibility_charts(run.metrics["mae"]), comparison_charts(comparison),
        diagnostics_charts(diagnostics_table()),
    ]  # fmt: skip


def test_every_chart_is_drawn_with_its_title_a_legend_and_the_same_bytes_each_time(run, tmp_path):
    for place, group in enumerate(all_charts(run)):
        picture = tmp_path / f"{place}.svg"
        draw_charts(group, "The heading", picture)
        svg = picture.read_text()
        for words in ("The heading", *(chart.title for chart in group.charts), *(name for name, _ in group.lines)):
            assert html.escape(words, quote=False) in svg
        assert "var(" not in svg
        draw_charts(group, "The heading", picture)
        assert picture.read_text() == svg
        assert svg.count("<path") > sum(len(chart.spec["data"]["values"]) for chart in group.charts)


def diagnostics_table():
    """Return four seconds of a filter's diagnostics; another vehicle becomes the ego after two."""
    step = np.arange(40)
    levels = {"components": step, "effective_share": 0.5, "association_entropy": 0.01 * step}
    events = {"births": np.where(step == 0, 99, 1), "deaths": 0, "merges": 2 * (step % 2), "reclusterings": 0}
    return pd.DataFrame({"time_s": 0.1 * step, "episode": step // 20, **levels, **events})


def test_diagnostics_are_means_over_stretches_with_the_range_of_their_steps():
    components, share, _, events = diagnostics_charts(diagnostics_table()).charts
    assert [(row["low"], row["mean"], row["high"]) for row in rows_of(components)[:2]] == [(0, 0.5, 1), (2, 2.5, 3)]
    assert {row["mean"] for row in rows_of(share)} == {50.0}
    births = [row["mean"] for row in rows_of(events) if row["series"] == "births"]
    assert births == pytest.approx([10.0] * len(births)), "the first scan of an ego is left out"
    assert {row["series"] for row in rows_of(events)} == {"births", "merges"}
    assert "new ego" in json.dumps(components.spec)


def test_charts_without_any_value_are_drawn_as_their_heading(tmp_path):
    draw_charts(Charts((), note="nothing"), "T", tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    assert error_charts(error_table().iloc[:0]).charts == ()
