"""A metric that a user registers is in every result, by its registration alone."""

import copy
import json
import shutil
import subprocess
import sys
from functools import partial

import pandas as pd
import pytest

from harness.analysis.compare import compare
from harness.analysis.comparison_text import as_markdown
from harness.analysis.pooled import pooled_quantities
from harness.analysis.rules import Rules
from harness.analysis.sources import open_source
from harness.analysis.verdicts import BETTER, WORSE
from harness.grid.grid import GridRequest
from harness.grid.stress import run_stress
from harness.lab.ablation import ablated_quantities
from harness.plugins import Quantity, register_metric
from harness.report.page import write_run_page
from harness.report.pictures import draw_figures
from harness.running.resolve import resolve_run_config
from harness.running.run import Drawing, run
from harness.scoring.metrics import registry
from tests.harness.grid.executors import InProcess
from tests.harness.stand_ins import SteadyTraffic, observing

pytestmark = [pytest.mark.usefixtures("read_here"), pytest.mark.slow]

ECHO = "tests.harness.stand_ins:echo_tracker"
STEPS = 8
TRACKS_PER_STEP = Quantity("toy.tracks", "tracks a step", higher_is_better=True, decimals=2, heading="tracks")


def tracks_per_step(evidence) -> dict[str, object]:
    steps = len(evidence.rows.time_s)
    return {"tracks": len(evidence.rows.tracks) / steps if steps else None}


@pytest.fixture(autouse=True, scope="module")
def toy():
    """Register a metric for the length of this module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "METRICS", copy.deepcopy(registry.METRICS))
        register_metric("toy", TRACKS_PER_STEP)(tracks_per_step)
        yield


@pytest.fixture(scope="module")
def finished(toy, tmp_path_factory):
    """Return a grid that no test may change."""
    request = GridRequest(densities="20", seeds="6", trackers=ECHO, duration_s=1.0)
    return run_stress(request, tmp_path_factory.mktemp("own") / "grid", InProcess())


def test_it_is_in_a_runs_metrics_and_on_its_page(tmp_path):
    config = resolve_run_config(options={"tracker": ECHO})
    snapshots = observing(SteadyTraffic(steps=STEPS))
    drawing = Drawing(draw_figures, write_run_page)
    folder = run(config, out=tmp_path / "run", draw=drawing, open_snapshots=snapshots).folder
    value = json.loads((folder / "metrics.json").read_text())["toy"]["tracks"]
    assert value == len(pd.read_parquet(folder / "tracks.parquet")) / STEPS > 0.0
    row = f"<tr><th scope='row'>tracks a step</th><td>{value:.2f}</td><td>higher</td>"
    before, heading, below = (folder / "report.html").read_text().partition("<h3>Your own metrics</h3>")
    assert row in below.partition("</table>")[0], heading
    assert row not in before


def test_it_has_a_column_a_curve_and_a_panel_in_a_stress_test_and_a_verdict_in_a_comparison(finished, tmp_path):
    rows = pd.read_parquet(finished.folder / "runs.parquet")
    assert rows["toy.tracks"].gt(0.0).all()
    (point,) = (point for point in finished.points if point.metric == "toy.tracks")
    assert point.mean == pytest.approx(rows["toy.tracks"].mean())
    assert "Your own metrics:\n\n| tracker | density | tracks a step |" in (finished.folder / "table.md").read_text()
    assert list((finished.folder / "figures").glob("*.png"))

    grid, fewer = open_source(str(finished.folder), "compare"), tmp_path / "fewer"
    fewer.mkdir()
    (fewer / "grid.json").write_text((finished.folder / "grid.json").read_text())
    for factor, word in ((0.5, WORSE), (2.0, BETTER)):
        rows.assign(**{"toy.tracks": factor * rows["toy.tracks"]}).to_parquet(fewer / "runs.parquet")
        comparison = compare(grid, open_source(str(fewer), "compare"), Rules(primary=("toy.tracks",)))
        assert {each.metric: each.verdict for each in comparison.verdicts}["toy.tracks"] == word
    assert "| tracks a step |" in as_markdown(comparison)


def test_runs_made_before_it_are_compared_without_it(finished, tmp_path):
    folder = shutil.copytree(finished.folder, tmp_path / "grid")
    pd.read_parquet(folder / "runs.parquet").drop(columns="toy.tracks").to_parquet(folder / "runs.parquet")
    (folder / "manifest.json").unlink()  # a grid of then noted no hashes
    source = open_source(str(folder), "compare")
    comparison = compare(source, source)
    assert "toy.tracks" not in {each.metric for each in comparison.verdicts}


def test_it_is_in_the_tables_of_recorded_traffic_and_of_the_ablation():
    assert TRACKS_PER_STEP in pooled_quantities()
    assert TRACKS_PER_STEP in ablated_quantities()


@pytest.fixture
def other(tmp_path):
    """Return what runs a command in another process, which finds the metric in the module ``mine``."""
    (tmp_path / "mine.py").write_text(
        "from harness.plugins import Quantity, register_metric\n"
        "@register_metric('toy', Quantity('toy.tracks', 'tracks a step'))\n"
        "def toy(evidence):\n    return {'tracks': 7.0}\n"
    )
    return partial(subprocess.run, cwd=tmp_path, capture_output=True, check=False)


def test_a_comparison_in_another_process_judges_it_where_its_module_is_named(finished, other):
    for name, code, word in (("mine:", 0, "tracks a step"), ("", 2, "no such metric"), ("none:", 2, "can't import")):
        words = ["-m", "harness", "compare", *2 * [str(finished.folder)], "--primary", f"{name}toy.tracks"]
        told = other([sys.executable, *words])
        assert (told.returncode, word in told.stderr.decode()) == (code, True)


def test_a_stress_test_of_a_built_in_tracker_has_it_where_a_setting_names_it(other, tmp_path):
    words = ["stress", "--densities", "20", "--seeds", "1", "--duration", "1", "--trackers", "pmbm", "--out", "grid"]
    for name, code in (("mine:toy", 0), ("mine:none", 2), ("mine", 2)):
        assert other([sys.executable, "-m", "harness", *words, "--set", f"metric={name}"]).returncode == code
    assert pd.read_parquet(tmp_path / "grid" / "runs.parquet")["toy.tracks"].tolist() == [7.0]
