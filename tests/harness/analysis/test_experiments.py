"""What is refused, or listed, where two folders are not one experiment with two trackers."""

import json
from pathlib import Path

import numpy as np
import pytest

from harness.analysis.compare import compare
from harness.analysis.experiments import differing
from harness.analysis.rules import Limit, Rules
from harness.analysis.sources import open_source
from harness.analysis.verdicts import NO_WORSE, UNDECIDED
from harness.commands.app import run_command_line
from harness.common import exit_codes
from harness.common.errors import InputError
from harness.storage.manifest import hashes_of
from tests.harness.analysis.test_compare import compared, edited, grid_folder, wobbling

MANIFEST = {"code_sha256": {"mmpf": "1a" * 32, "my_kf": "2b" * 32}, "inputs_sha256": {"model.npz": "3c" * 32}}


def with_grid(folder: str, **table) -> str:
    (Path(folder) / "grid.json").write_text(json.dumps({"vary": []} | table))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("one", "other", "told"),
    [
        ({"duration_s": 8.0}, {"duration_s": 10.0}, "traffic.duration_s 8 in a, 10 in b"),
        ({}, {"duration_s": 10.0}, "traffic.duration_s 60 in a, 10 in b"),
        ({"sensor": "radar"}, {}, "sensor.profile radar in a, lidar in b"),
        ({}, {"settings": ["sensor.range_m=60"]}, "sensor.range_m not set in a, 60 in b"),
        ({"driver": "idm"}, {"driver": "hdm"}, "drive.driver idm in a, hdm in b"),
    ],
)
def test_different_experiments_are_refused_and_listed_where_that_is_allowed(one, other, told, tmp_path, capsys):
    a, b = (with_grid(grid_folder(tmp_path / name), **table) for name, table in (("a", one), ("b", other)))
    assert run_command_line(["compare", a, b]) == exit_codes.WRONG_INPUT
    message = capsys.readouterr().err
    assert told in message
    assert "--allow-different" in message
    assert run_command_line(["compare", a, b, "--allow-different", "--markdown", str(tmp_path / "out.md")]) == 0
    assert told in " ".join(capsys.readouterr().err.split())
    assert told in (tmp_path / "out.md").read_text()


def test_what_is_the_same_by_default_is_no_difference(tmp_path):
    a, b = with_grid(grid_folder(tmp_path / "a"), sensor="lidar", duration_s=60), grid_folder(tmp_path / "b")
    assert compared(a, b).differing == ()


def test_a_setting_that_only_one_of_two_trackers_has_is_no_difference():
    a, b = {"tracker.name": "mmpf", "tracker.update": "joint"}, {"tracker.name": "pmbm"}
    assert differing(a, b) == ([], [])
    assert differing(a, b | {"tracker.name": "mmpf"})[1] == ["tracker.update joint in a, not set in b"]


def test_trackers_may_differ_in_settings_code_and_model_and_that_is_listed(tmp_path):
    a, b = (with_grid(grid_folder(tmp_path / name), particles=n) for name, n in (("a", 100), ("b", 200)))
    (tmp_path / "a" / "manifest.json").write_text(json.dumps(MANIFEST))
    other = {"code_sha256": {"mmpf": "1a" * 32, "my_kf": "4d" * 32}, "inputs_sha256": {"model.npz": "5e" * 32}}
    (tmp_path / "b" / "manifest.json").write_text(json.dumps(other))
    assert compared(a, b).differing == (
        "tracker.particles 100 in a, 200 in b",
        "the code of my_kf (2b2b2b2b in a, 4d4d4d4d in b)",
        "the file model.npz (3c3c3c3c in a, 5e5e5e5e in b)",
    )


def test_pairs_that_did_not_see_the_same_are_refused_and_then_not_paired(tmp_path):
    """As where traffic, network or sensor came in another version, though seeds and settings are the same."""
    a = grid_folder(tmp_path / "a", coverage__detected=lambda seed: 100.0 + seed)
    b = grid_folder(tmp_path / "b", coverage__detected=lambda seed: 100.0 + seed + (seed > 7))
    with pytest.raises(InputError, match="the traffic or the detections of 2 of 10 pairs"):
        compared(a, b)
    found = compare(open_source(a, "a"), open_source(b, "b"), allow_different=True)
    assert found.differing == ("traffic or detections of 2 of 10 pairs, so that nothing is paired",)
    assert any("whole arms are compared" in note for note in found.notes)


@pytest.mark.parametrize(
    ("metric", "value"),
    [
        *(("mot.hota", 500.0), ("hidden.hidden_cost_m", -1.0), ("occlusion.same_id_percent", 300.0)),
        *(("mot.hota", True), ("mot.hota", np.inf), ("hidden.hidden_cost_m", -np.inf), ("coverage.detected", "many")),
    ],
)
def test_values_that_a_metric_can_not_have_are_refused(metric, value, tmp_path, refused):
    a = grid_folder(tmp_path / "a")
    b = edited(grid_folder(tmp_path / "b"), lambda table: table.assign(**{metric: value}))
    assert f"{metric} holds" in refused("compare", a, b)


def test_an_edited_table_of_runs_is_recognised_by_its_hash(tmp_path):
    a, b = grid_folder(tmp_path / "a"), grid_folder(tmp_path / "b", mot__hota=lambda seed: 0.5)
    (tmp_path / "b" / "manifest.json").write_text(json.dumps({"files_sha256": hashes_of(tmp_path / "b")}))
    (note,) = (note for note in compared(a, b).notes if "SHA-256" in note)
    assert note.startswith(f"{a}: there is no SHA-256 of grid.json and 1 more")
    edited(b, lambda table: table.assign(**{"mot.hota": 2.0}))
    with pytest.raises(InputError, match=r"runs\.parquet was changed after it was written"):
        compared(a, b)
    for content in (bytes(8), b'{"files_sha256": null}'):
        (tmp_path / "b" / "manifest.json").write_bytes(content)
        with pytest.raises(InputError, match=r"manifest\.json is broken"):
            compared(a, b)


def test_bounds_and_tolerances_of_single_metrics_are_kept(tmp_path):
    a = grid_folder(tmp_path / "a", mot__hota=wobbling(80.0))
    b = grid_folder(tmp_path / "b", mot__hota=lambda seed: 0.95 * wobbling(80.0)(seed))

    def outcome(**limit: float) -> tuple[str, str]:
        rules = Rules(primary=("mot.hota",), limits={"mot.hota": Limit(**limit)})
        found = compare(open_source(a, "a"), open_source(b, "b"), rules)
        return found.outcome, found.verdicts[0].breach

    assert outcome(tolerance=0.1) == (NO_WORSE, "")
    assert outcome(tolerance=0.1, floor=70.0) == (NO_WORSE, "")
    word, breach = outcome(tolerance=0.1, floor=77.0)
    assert (word, breach.endswith("is below the floor of 77")) == ("worse", True)
    assert outcome(tolerance=0.1, ceiling=70.0)[0] == "worse"


def test_an_interval_that_reaches_beyond_what_can_be_says_too_few_and_how_many_more(tmp_path):
    noise = [-6.0, 5.0]
    a = grid_folder(tmp_path / "a", range(2), mot__hota=lambda seed: 92.0)
    b = grid_folder(tmp_path / "b", range(2), mot__hota=lambda seed: 88.0 + noise[seed])
    found = compared(a, b)
    hota = next(one for one in found.verdicts if one.metric == "mot.hota")
    assert (hota.verdict, hota.wanting) == (UNDECIDED, "too few to tell")
    assert np.isnan(hota.ci95).all()
    assert any("Too few seeds for a verdict (HOTA in sight" in why and "more seeds" in why for why in found.reasons)
