import json
from dataclasses import asdict

import pytest

from harness.report.folder_page import write_page
from harness.report.pictures import write_pictures
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.report.test_charts import REQUEST, grid_table

MAGIC = {"png": b"\x89PNG", "svg": b"<svg", "pdf": b"%PDF"}


@pytest.fixture
def grid(tmp_path):
    (tmp_path / "grid.json").write_text(json.dumps(asdict(REQUEST)))
    grid_table().to_parquet(tmp_path / "runs.parquet")
    return tmp_path


@pytest.mark.parametrize("kind", MAGIC)
def test_a_stress_tests_curves_are_drawn_in_the_format_asked_for_with_the_same_bytes_each_time(grid, kind):
    (picture,) = write_pictures(grid, kind)
    assert picture == grid / "figures" / f"over_density.{kind}"
    first = picture.read_bytes()
    assert first.startswith(MAGIC[kind])
    write_pictures(grid, kind)
    assert picture.read_bytes() == first


def test_a_runs_errors_and_worst_moments_are_drawn_and_the_page_stays_as_it_was(tmp_path):
    folder = write_recorded_scene(tmp_path / "run")
    before = write_page(folder).read_bytes()
    names = {path.name for path in write_pictures(folder, "svg")}
    assert names == {"error_over_time.svg", "error_by_visibility.svg", "failure-1.svg"}
    assert write_page(folder).read_bytes() == before


def test_what_cannot_be_drawn_is_refused_in_a_line(grid, tmp_path_factory, refused):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.report.pictures.write_pictures", lambda folder, kind: 1 / 0)
        assert "--figures: it can't be drawn (ZeroDivisionError" in refused("report", grid, "--figures", "svg")
    (grid / "table.md").write_text("# T\n")
    assert "choose one of png, svg, pdf" in refused("report", grid, "--figures", "jpeg")
    assert not (grid / "report.html").exists()
    study = tmp_path_factory.mktemp("study")
    (study / "results.md").write_text("# Study\n")
    assert "only their figures can be drawn" in refused("report", study, "--figures", "svg")
