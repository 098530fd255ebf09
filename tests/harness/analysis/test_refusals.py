"""What a comparison shows and refuses, from made-up rows of runs."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from harness.analysis.compare import Judgement, compare
from harness.analysis.comparison_text import as_markdown
from harness.analysis.rules import STEP_TIME, Rules, compared_quantities
from harness.analysis.sources import Source, open_source
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE
from harness.analysis.why import CAUSES, KINDS, TrackFailure, Why
from harness.api import Run
from harness.common.errors import InputError
from harness.scoring.metrics.closedloop import COLLIDED, HARD_BRAKES, KM
from harness.scoring.metrics.closedloop import PRIMARY as DRIVEN
from tests.harness.analysis.test_comparison_text import comparison, verdict

NAN = float("nan")


def told() -> Judgement:
    """Return a comparison with every word, numbers that are missing, and causes."""
    verdicts = [
        verdict(word=WORSE), verdict("hidden.hidden_cost_m", UNDECIDED, a=0.0, more_units=7, difference=0.123),
        verdict("occlusion.same_id_percent", BETTER, difference=12.0, ci95=(NAN, NAN)), verdict(label="jpda", p=NAN),
        verdict("mot.idf1", UNTESTED, primary=False, label="jpda", b=NAN, difference=NAN, ci95=(NAN, NAN), p=NAN),
    ]  # fmt: skip
    failures = [TrackFailure(kind, cause, f"flow {kind} {cause}", 0.5 * k, k, k + 1) for k, (kind, cause) in enumerate(
        [(KINDS[0], CAUSES[1]), (KINDS[1], CAUSES[4]), (KINDS[0], CAUSES[1])])]  # fmt: skip
    return comparison(*verdicts, why=Why(tuple(failures), tuple(failures[1:2]), "A", "B/c d"))


def test_a_page_shows_verdicts_in_order_with_units_intervals_and_failures():
    text = as_markdown(told())
    assert text.startswith("## Worse: ")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    metrics = [line.split(" | ")[0].removeprefix("| ") for line in rows]
    first = ["metric", "---", "HOTA in sight, %", "hidden cost (10 m if lost), m", "same identity, %"]
    assert metrics[:5] == first
    assert "| -3.25 to -0.75 |" in rows[2]
    assert rows[2].endswith("| **worse** |")
    assert "| - |" in rows[4], "an interval that is missing is a dash"
    assert any(line.startswith("| identity switch, a | 0 | 2 |") for line in rows)
    assert "(B/c%20d/report.html#t=" in text
    beside = text.replace("A/report.html", "").replace("B/c%20d/report.html", "")
    assert as_markdown(told(), with_replay=True) == beside != text


def undecided(metric: str = "mot.hota", **other):
    return verdict(metric, UNDECIDED, **other)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (comparison(verdict()), []),
        (comparison(verdict("mot.idf1", UNTESTED, primary=False)), ["None of the metrics"]),
        (comparison(verdict(), wanting=("b lacks a run.",)), ["b lacks a run."]),
        (comparison(undecided(more_units=7), undecided("mot.idf1", more_units=9)), ["about 9 more seeds"]),
        (
            comparison(undecided(more_units=7), undecided("mot.idf1"), units="recordings"),
            ["more recordings would hardly"],
        ),
        (comparison(undecided(more_units=7), units="vehicles"), ["stress tests of several seeds"]),
        (
            comparison(undecided(wanting="too few"), undecided("mae.hidden.lon_m", wanting="too few", label="jpda")),
            ["mmpf cvm: too few (HOTA in sight).", "jpda: too few"],
        ),
    ],
)
def test_why_nothing_may_be_concluded_is_told(found, words):
    assert all(any(word in reason for reason in found.reasons) for word in words)
    assert len(found.reasons) == len(words)
    assert found.outcome == (UNDECIDED if words else NO_WORSE)
    table = found.as_table()
    assert (table["regression"], table["outcome"], table["reasons"]) == (False, found.outcome, list(found.reasons))


def test_the_table_for_programs_has_causes_and_no_nan():
    table = told().as_table()
    assert (table["a"], table["b"], table["regression"], table["outcome"]) == ("old", "new", True, WORSE)
    assert table["causes"] == told().why.counts()
    assert table["verdicts"][4]["b"] is None
    assert list(table) == [
        "a", "b", "verdicts", "notes", "rules", "units", "wanting", "why", "differing", "paired",
        "regression", "outcome", "reasons", "causes",
    ]  # fmt: skip
    json.dumps(table, allow_nan=False)


def rows(labels=("mmpf cvm",), seeds=range(4), density=20.0, **columns) -> pd.DataFrame:
    """Return rows in which every metric is one half and a little of the seed, unless given."""
    metrics = {quantity.key: [] for quantity in compared_quantities()}
    made = [
        {"net": "us101", "density": density, "demand": None, "seed": seed, "label": label}
        | dict.fromkeys(metrics, 0.5 + 0.01 * seed) | {STEP_TIME.key: 5.0} | columns
        for label in labels for seed in seeds
    ]  # fmt: skip
    return pd.DataFrame(made)


def source(name: str = "a", table: pd.DataFrame | None = None, **other) -> Source:
    known = {"folder": Path("in") / name, "rows": rows() if table is None else table, "failed": 0, "is_run": False}
    return Source(name, **(known | other))


def refused(a: Source, b: Source, rules: Rules | None = None) -> str:
    with pytest.raises(InputError) as caught:
        compare(a, b, rules)
    return str(caught.value)


def test_what_b_lacks_of_runs_and_trackers_is_wanting():
    both = ("mmpf cvm", "jpda", "pmbm")
    a = source("a", rows(both, range(8)))
    found = compare(a, source("b", rows(("mmpf cvm",), range(3)), failed=3))
    assert found.wanting == (
        "3 runs of b failed; make them again by --resume --retry-failed.",
        "b has no finished run of jpda, pmbm; choose one tracker by FOLDER@LABEL if that is meant.",
        "mmpf cvm: b lacks 5 of the 8 runs of a (us101, density 20: seeds 3 to 7).",
    )
    one = compare(source("a", rows(("x",))), source("b", rows(("y",))))
    assert one.wanting == ()
    assert {each.label for each in one.verdicts} == {"x (a), y (b)"}


def test_comparisons_that_make_no_sense_are_refused_with_the_reason():
    drives, varied = source("b", rows(**{COLLIDED: 0.0})), source("b", axes=("sensor.range_m",))
    failed = source("b", rows(seeds=()).reindex(columns=list(rows())))
    for a, b, reason in (
        (source(), drives, "holds drives"), (drives, source(), "holds drives"), (source(), failed, "b failed"),
        (source(), varied, "different settings"), (varied, replace(varied, name="c"), "sensor.range_m"),
        (source("a", rows(("x", "y"))), source("b", rows(("z",))), "no tracker in common"),
        (source(), source("b", rows(density=40.0)), "no setting in common"),
    ):  # fmt: skip
        assert reason in refused(a, b)
    for key, reason in (("x", "`primary` x"), ("pseudo_occlusion.3s.ellipse90_percent", "best near 90")):
        assert reason in refused(source(), source(), Rules(primary=("mot.hota", key)))


def test_drives_are_judged_by_their_own_metrics_unless_others_are_named():
    keys = [quantity.key for quantity in compared_quantities(DRIVEN, closed_loop=True)]
    drives = source("a", rows(**dict.fromkeys(keys, 1.0)))
    found = compare(drives, replace(drives, name="b", folder=Path("in/b")))
    assert found.rules == Rules(primary=DRIVEN)
    assert [each.metric for each in found.verdicts] == keys
    assert found.notes == ()
    assert compare(drives, drives, Rules(primary=(keys[-1],))).rules.primary == (keys[-1],)


@pytest.mark.parametrize(("followed", "error", "warned"), [(0.5, 0.5, True), (0.5, 1.5, False), (1.5, 0.5, False)])
def test_smaller_errors_over_fewer_followed_vehicles_are_warned_of(followed, error, warned):
    both = rows(("x", "y"), range(8))
    shrunk = {"hidden_outcomes.tracked_percent": followed, "mae.hidden.speed_mps": error}
    less = both.assign(**{key: both[key] * factor for key, factor in shrunk.items()})
    less = pd.concat([less[less["label"] == "x"], both[both["label"] == "y"]])
    note = "x: hidden errors are over vehicles still followed; b follows fewer, so its smaller errors are no gain."
    assert (note in compare(source("a", both), source("b", less)).notes) == warned


def grid_folder(folder: Path, table: pd.DataFrame | None = None, vary=()) -> Path:
    folder.mkdir(parents=True)
    made = rows().drop(columns="label") if table is None else table
    made = made.assign(variant="mmpf", model="cvm") if "variant" not in made else made
    (made if "succeeded" in made else made.assign(succeeded=True)).to_parquet(folder / "runs.parquet")
    (folder / "grid.json").write_text(json.dumps({"vary": list(vary)}))
    return folder


def unopened(text: object) -> str:
    with pytest.raises(InputError) as caught:
        open_source(str(text), "baseline")
    return str(caught.value)


def test_a_grid_is_opened_whole_or_by_the_label_of_a_tracker(tmp_path):
    table = rows(mismatch="noise").drop(columns="label").assign(
        variant=["mmpf", "mmpf", "pmbm", "pmbm"], model=["cvm", "cvm", None, None], succeeded=[True, True, True, False],
        **{"sensor.range_m": 40.0},
    )  # fmt: skip
    folder = grid_folder(tmp_path / "a@b", table, [" sensor.range_m = 40,50"])
    found = open_source(str(folder), "baseline")
    assert (found.name, found.folder, found.failed, found.is_run) == (str(folder), folder, 1, False)
    assert (found.axes, found.labels, len(found.rows)) == (("sensor.range_m", "mismatch"), ["mmpf cvm", "pmbm"], 3)
    assert not found.is_closed_loop
    one = open_source(f"{folder}@mmpf cvm", "baseline")
    assert (one.name, one.labels, len(one.rows), one.failed) == (f"{folder}@mmpf cvm", ["mmpf cvm"], 2, 0)
    assert unopened(f"{folder}@x") == f"`baseline`: {folder} has no tracker 'x'; choose one of mmpf cvm, pmbm"
    standard = grid_folder(tmp_path / "reference" / "standard")
    assert open_source(str(tmp_path / "reference"), "baseline").folder == standard


def test_a_folder_that_holds_no_grid_or_run_is_told_why(tmp_path):
    assert "is not a folder" in unopened(tmp_path / "missing")
    for number, content in enumerate(("no", "{}", '{"vary": 3}')):
        folder = grid_folder(tmp_path / str(number))
        (folder / "grid.json").write_text(content)
        assert f"{folder / 'grid.json'}: broken, or no list" in unopened(folder)
    table = rows().drop(columns="label")
    spoilt = {
        "has no rows": table.iloc[:0],
        "has several rows of one run": pd.concat([table, table.iloc[:1]]),
        "mot.hota holds no numbers": table.assign(**{"mot.hota": "high"}),
    }
    for why, content in spoilt.items():
        assert why in unopened(grid_folder(tmp_path / why, content))
    assert open_source(str(grid_folder(tmp_path / "none", table.assign(**{"mot.hota": None}))), "x").failed == 0
    for column in ("density", "replay", "mismatch", "sensor.range_m"):
        twice = pd.concat([table.assign(**{column: value}) for value in (1.0, 2.0)])
        folder = grid_folder(tmp_path / f"two {column}", twice, ["sensor.range_m=1,2"] if "sensor" in column else [])
        assert len(open_source(str(folder), "x").rows) == 8


RUN = {"net": "us101", "density": None, "demand": "light", "seed": 3, "tracker": "mmpf", "model": "cvm"}


def test_brakes_a_kilometre_are_all_brakes_over_all_kilometres_of_a_side():
    keys = [quantity.key for quantity in compared_quantities(DRIVEN, closed_loop=True)]
    brakes, km = np.array([[2.0, 5.0, 6.0, 8.0], [5.0, 4.0, 9.0, 3.0]]), np.array([[1.0, 2, 3, 4], [2.0, 2, 5, 1]])
    sides = [
        source(name, rows(**dict.fromkeys(keys, 1.0)).assign(**{HARD_BRAKES: brakes[k] / km[k], KM: km[k]}))
        for k, name in enumerate("ab")
    ]
    (found,) = (each for each in compare(*sides).verdicts if each.metric == HARD_BRAKES)
    assert (found.a, found.b) == pytest.approx(tuple(brakes.sum(axis=1) / km.sum(axis=1)))
    # Of a ratio of totals, the scatter is that of what each episode adds to it.
    shares = (brakes - km * np.array([[found.a], [found.b]])) / km.mean(axis=1, keepdims=True)
    half = stats.t.ppf(0.975, 3) * np.std(shares[1] - shares[0], ddof=1) / 2.0
    assert found.ci95 == pytest.approx((found.difference - half, found.difference + half))


def test_a_run_is_opened_as_one_row_or_told_to_be_broken(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.analysis.sources.runfolder.read_manifest", lambda folder, parameter: {})
    (tmp_path / "config.toml").write_text("")
    metrics = tmp_path / "metrics.json"
    odd = [{"run": _without(key)} for key in RUN] + [
        {"run": RUN, "mot": {"hota_ci95": ends}} for ends in ([1, 2, 3], 1)
    ]
    for content in ("no", "[]", "{}", '{"run": 5}', *map(json.dumps, odd)):
        metrics.write_text(content)
        assert re.search(rf"{re.escape(str(metrics))}(: broken, or no scores of a run| is )", unopened(tmp_path))
    metrics.write_text('{"run": [1]}')
    with pytest.raises(InputError, match="run is no table"):
        _ = Run(tmp_path).about
    metrics.write_text(json.dumps({"run": RUN, "mot": {"hota": 80.0}}))
    found = open_source(str(tmp_path), "baseline")
    assert (found.name, found.folder, found.failed, found.is_run, found.axes) == (str(tmp_path), tmp_path, 0, True, ())
    (row,) = found.rows.to_dict("records")
    assert row == RUN | {"variant": "mmpf", "mot.hota": 80.0, "label": "mmpf cvm"}


def _without(key: str) -> dict:
    return {name: value for name, value in RUN.items() if name != key}
