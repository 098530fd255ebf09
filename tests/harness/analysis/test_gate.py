"""The gate of a change: exit codes, JUnit's XML, summary and file of limits, and how often its verdict is right."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from harness.analysis.compare import compare
from harness.analysis.curves import labelled
from harness.analysis.gate import as_junit, as_summary
from harness.analysis.rules import PRIMARY
from harness.analysis.sources import Source
from harness.analysis.verdicts import UNDECIDED, UNTESTED, WORSE
from harness.analysis.why import TrackFailure, Why
from harness.commands.app import run_command_line
from harness.common import exit_codes
from tests.harness.analysis.test_compare import grid_folder, wobbling
from tests.harness.analysis.test_comparison_text import comparison, verdict

BASELINE = Path(__file__).parents[3] / "results" / "reference" / "standard" / "runs.parquet"
SCATTER = {"hidden.hidden_cost_m": 0.044, "mot.hota": 0.018, "occlusion.same_id_percent": 0.122}
"""By how much a cell differs between two runs of one tracker on the same detections: standard deviations as shares.

Measured by runs of mmpf cvm with 200, 201, 202 and 203 particles on the detections of seeds 0 to 3 at 40 vehicles per
km and lane, 30 s: random numbers fall otherwise when anything in a tracker changes.
"""
NOISE = [-0.03, 0.02, 0.04, -0.05]


def gate(*words: object) -> int:
    return run_command_line(["compare", *map(str, words), "--quiet"])


@pytest.mark.parametrize(
    ("b", "code", "failures", "skipped"),
    [
        ({}, exit_codes.DONE, 0, 0),
        ({"mot__hota": lambda seed: 0.9 * wobbling(80.0)(seed)}, exit_codes.WORSE, 1, 0),
        ({"mot__hota": lambda seed: (1.0 + NOISE[seed % 4]) * wobbling(80.0)(seed)}, exit_codes.UNDECIDED, 0, 1),
        ({"seeds": range(8)}, exit_codes.UNDECIDED, 0, 1),
    ],
)
def test_exit_code_junit_and_summary_say_the_same(b, code, failures, skipped, tmp_path):
    usual = {"mot__hota": wobbling(80.0)}
    first, second = grid_folder(tmp_path / "a", **usual), grid_folder(tmp_path / "b", **(usual | b))
    junit, summary = tmp_path / "gate.xml", tmp_path / "summary.md"
    assert gate(first, second, "--junit", junit, "--summary", summary) == code
    suite = ElementTree.fromstring(junit.read_text())
    assert (suite.get("tests"), suite.get("errors")) == (str(len(PRIMARY) + 1), "0")
    assert (suite.get("failures"), suite.get("skipped")) == (str(failures), str(skipped))
    assert (len(list(suite.iter("failure"))), len(list(suite.iter("skipped")))) == (failures, skipped)
    word = {exit_codes.DONE: "### No worse", exit_codes.WORSE: "### Worse", exit_codes.UNDECIDED: "### Undecided"}[code]
    assert summary.read_text().startswith(word)
    allowed = exit_codes.DONE if code == exit_codes.UNDECIDED else code
    assert gate(first, second, "--allow-undecided") == allowed


def test_wrong_input_and_files_that_are_there_write_nothing(tmp_path, capsys):
    a, precious = grid_folder(tmp_path / "a"), tmp_path / "precious.py"
    precious.write_text("import this\n")
    for option in ("--markdown", "--html", "--junit", "--summary"):
        assert gate(a, a, option, precious) == exit_codes.WRONG_INPUT
        assert "exists and no comparison wrote it; add --force" in capsys.readouterr().err
    assert precious.read_text() == "import this\n"
    assert gate(a, a, "--markdown", precious, "--force") == exit_codes.DONE
    for words, told in (
        (("--markdown", tmp_path / "x", "--html", tmp_path / "." / "x"), "--html: .*x is --markdown too"),
        (("--gate", precious, "--junit", precious, "--force"), "--junit: .* is --gate too"),
        (("--html", f"{a}/runs.parquet", "--force"), "--html: .*runs.parquet is of what is compared"),
        (("--html", tmp_path / "none" / "x"), "--html: there is no folder .*none"),
        (("--workers", 2), "--workers: only --suite uses it"),
        (("--pages", "https://ci.example"), "--pages: only --summary uses it"),
        (("--suite", "standard", "--record", "--html", tmp_path / "x"), "--html: with --record nothing is compared"),
    ):
        assert gate(*([] if "--record" in words else [a, a]), *words) == exit_codes.WRONG_INPUT
        assert re.search(told, capsys.readouterr().err)
    assert gate(a, tmp_path / "none", "--junit", tmp_path / "gate.xml") == exit_codes.WRONG_INPUT
    assert not (tmp_path / "gate.xml").exists()


def test_a_case_tells_the_tracker_the_metric_and_the_numbers_in_valid_xml():
    found = comparison(
        verdict(word=WORSE, label="<mine> & \x01"), verdict("mot.idf1", UNTESTED, primary=False),
        verdict("occlusion.same_id_percent", UNDECIDED, more_units=7, wanting="too few to tell"),
    )  # fmt: skip
    worse, undecided, whole = ElementTree.fromstring(as_junit(found)).iter("testcase")
    assert (worse.get("classname"), worse.get("name")) == ("<mine> & ?", "mot.hota")
    told = worse.find("failure").get("message")
    assert told.startswith("HOTA in sight, %: worse: 80.00 to 78.00, difference -2.00 (-2.5 %), 95 % interval -3.25 to")
    assert undecided.find("skipped").get("message").endswith("too few to tell; about 7 more needed")
    assert whole.find("failure") is None
    lost = verdict("mae.hidden.lon_m", UNDECIDED, primary=False, wanting="b lacks 3 of the 10 values that a has")
    *_, whole = ElementTree.fromstring(as_junit(comparison(verdict(), lost))).iter("testcase")
    assert "b lacks 3 of the 10 values" in whole.find("skipped").get("message")


def test_links_of_a_summary_lead_to_where_the_pages_are_and_nowhere_without_an_address():
    why = Why((TrackFailure("identity switch", "merge", "car 1", 12.3, 3, 4),), (), "results/old", "results/new")
    found = comparison(verdict(word=WORSE), why=why)
    assert "](" not in as_summary(found)
    assert "](https://ci.example/7/old/report.html#t=11.3&vehicle=car%201)" in as_summary(
        found, "https://ci.example/7/"
    )


@pytest.mark.slow
def test_a_gate_file_names_metrics_with_tolerances_floors_and_ceilings(tmp_path, capsys):
    usual = {"mot__hota": wobbling(80.0), "mot__idf1": wobbling(70.0)}
    a = grid_folder(tmp_path / "a", **usual)
    b = grid_folder(tmp_path / "b", **(usual | {"mot__hota": lambda seed: 0.95 * wobbling(80.0)(seed)}))
    file = tmp_path / "gate.toml"

    def with_gate(text: str, *words: str) -> int:
        file.write_text(text)
        return gate(a, b, "--gate", file, *words)

    assert with_gate("") == exit_codes.WORSE
    assert with_gate("tolerance = 0.1") == exit_codes.DONE
    assert with_gate("tolerance = 0.1", "--tolerance", "0.02") == exit_codes.WORSE
    assert with_gate('[metrics."mot.hota"]\ntolerance = 0.1\nfloor = 70.0') == exit_codes.DONE
    assert with_gate('[metrics."mot.hota"]\ntolerance = 0.1\nfloor = 79.0') == exit_codes.WORSE
    assert with_gate('[metrics."mot.hota"]\nfloor = 79.0', "--primary", "mot.idf1") == exit_codes.WORSE
    assert with_gate('[metrics."mot.idf1"]') == exit_codes.DONE
    assert with_gate('[metrics."mot.idf1"]\nceiling = 60') == exit_codes.WORSE
    for wrong, told in (
        ("tolerance = -1", "greater than or equal to 0"), ("tolerance = true", "valid number"),
        ("floors = 3", "unknown key"),
        ('[metrics."mot.hota"]\ntolerance = 5', "0 to 1"), ('[metrics."mot.hota"]\nfloor = 600', "from 0 to 100"),
        ('[metrics."mot.hota"]\nfloor = 60\nceiling = 50', "above it"),
        ('[metrics."mot.x"]', "(your own: --primary MODULE:mot.x, and its key alone in a gate file)"),
        ('[metrics."mot.hota"]\nfloor = nan', "finite"), ("a = ", "TOML"),
    ):  # fmt: skip
        capsys.readouterr()
        assert with_gate(wrong) == exit_codes.WRONG_INPUT, wrong
        assert told in capsys.readouterr().err
    assert gate(a, b, "--gate", tmp_path / "none.toml") == exit_codes.WRONG_INPUT


@pytest.mark.slow
@pytest.mark.parametrize(("planted", "least", "most"), [(1.05, 14, 16), (1.0, 0, 1)])
def test_a_planted_regression_is_called_worse_and_an_unchanged_tracker_is_not(planted, least, most):
    """Ten seeds resampled from the committed ones, two densities; 5 % more hidden cost, other random numbers."""
    rng, table = np.random.default_rng(36), labelled(pd.read_parquet(BASELINE))
    table = table[table["model"] == "cvm"]
    failed = 0
    for _ in range(16):
        drawn = rng.integers(0, 10, 10)
        rows = pd.concat([table[table["seed"] == seed].assign(seed=place) for place, seed in enumerate(drawn)])
        other = rows.copy()
        for key, share in SCATTER.items():
            factor = 1.0 + share * rng.standard_normal(len(rows))
            cost = key == "hidden.hidden_cost_m"
            other[key] = (rows[key] * factor * (planted if cost else 1.0)).clip(upper=None if cost else 100.0)
        sides = (Source(name, Path(name), of, 0, False) for name, of in (("a", rows), ("b", other)))
        failed += compare(*sides).outcome == WORSE
    assert least <= failed <= most, failed
