"""Comparisons of folders, as the command makes them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.analysis.compare import Judgement, compare
from harness.analysis.rules import Rules, compared_quantities
from harness.analysis.single import compare_runs, evidence_of, read_seen
from harness.analysis.sources import open_source
from harness.analysis.verdicts import NO_WORSE, UNDECIDED, UNTESTED, WORSE
from harness.commands.app import run_command_line
from harness.common import exit_codes
from harness.common.errors import InputError
from harness.grid.grid import GridRequest
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage.tables import write_table
from tests.harness.grid.executors import InProcess
from tests.harness.stand_ins import SteadyTraffic, observing

ECHO = "tests.harness.stand_ins:echo_tracker"


def grid_folder(folder: Path, seeds=range(10), model="cvm", densities=(20.0,), failed=(), vary=(), **metrics) -> str:
    """Write a grid's folder: a metric grows a little with the seed, unless given as a function of it."""
    rows = [
        {
            "net": "us101", "density": density, "demand": None, "tracker": "mmpf", "variant": "mmpf", "model": model,
            "update": "joint", "seed": seed, "succeeded": seed not in failed, "error": None, "total_s": 1.0,
            **{each.key: min(1.0, 0.5 * each.most) * (1.0 + 0.01 * seed) for each in compared_quantities()},
            **{name.replace("__", "."): value(seed) for name, value in metrics.items()},
        }
        for density in densities for seed in seeds
    ]  # fmt: skip
    folder.mkdir()
    write_table(pd.DataFrame(rows), folder / "runs.parquet")
    (folder / "grid.json").write_text(json.dumps({"vary": list(vary)}))
    return str(folder)


def edited(folder: str, change) -> str:
    """Change the table of runs of a grid's folder, and return the folder."""
    change(pd.read_parquet(f"{folder}/runs.parquet")).to_parquet(f"{folder}/runs.parquet")
    return folder


def compared(a: str, b: str, tolerance: float = 0.02) -> Judgement:
    return compare(open_source(a, "compare"), open_source(b, "compare"), Rules(tolerance))


def words(comparison: Judgement) -> dict[str, str]:
    """Return the words of the metrics that get a verdict."""
    return {verdict.metric: verdict.verdict for verdict in comparison.verdicts if verdict.primary}


def wobbling(mean: float, seed_of_noise: int = 0):
    """Return a metric that differs from seed to seed."""
    noise = np.random.default_rng(seed_of_noise).normal(mean, 0.01 * mean, 100)
    return lambda seed: noise[seed]


@pytest.mark.parametrize("score", ["hidden__hidden_cost_m", "hidden__hidden_crps_m"])
def test_a_hidden_cost_that_falls_while_false_hidden_tracks_increase_decides_nothing(score, tmp_path):
    costs = {"a": (4.0, 1.0), "b": (3.0, 5.0), "c": (3.0, 0.5)}
    for name, values in costs.items():
        cost, false = (wobbling(value, place) for place, value in enumerate(values))
        grid_folder(tmp_path / name, hidden__false_hidden_tracks_per_scan=false, **{score: cost})
    found = [compared(str(tmp_path / "a"), str(tmp_path / name)) for name in costs]
    assert ["guesses lower both" in " ".join(each.reasons) for each in found] == [False, True, False]
    assert [each.outcome for each in found] == [NO_WORSE, UNDECIDED, NO_WORSE]


def test_a_grid_against_itself_is_no_worse_however_few_seeds_it_has(tmp_path):
    for seeds in (1, 10):
        folder = grid_folder(tmp_path / f"a{seeds}", seeds=range(seeds))
        comparison = compared(folder, folder)
        assert set(words(comparison).values()) == {NO_WORSE}
        assert comparison.outcome == NO_WORSE


@pytest.mark.parametrize("seeds", [3, 5])
def test_a_catastrophe_is_worse_with_few_seeds_and_never_no_difference(seeds, tmp_path, capsys):
    """As in a trial: HOTA from 98 to 65, same identity from 100 to 0 %."""
    kept = {"mot__hota": wobbling(98.0), "hidden__hidden_cost_m": wobbling(2.0)}
    lost = {"mot__hota": wobbling(65.0, 1), "hidden__hidden_cost_m": wobbling(5.0, 1)}
    a = grid_folder(tmp_path / "a", range(seeds), occlusion__same_id_percent=wobbling(98.0), **kept)
    b = grid_folder(tmp_path / "b", range(seeds), occlusion__same_id_percent=wobbling(2.0), **lost)
    assert run_command_line(["compare", a, b]) == exit_codes.WORSE
    told = capsys.readouterr().err
    assert "Worse: b is worse in HOTA" in told
    assert "no difference" not in told


def test_want_of_data_is_undecided_with_a_code_of_its_own_and_says_what_would_decide_it(tmp_path, capsys):
    noise = np.random.default_rng(0).normal(0.0, 0.1, (2, 10))
    a = grid_folder(tmp_path / "a", range(4), mot__hota=lambda seed: 90.0 + 20.0 * noise[0, seed])
    b = grid_folder(tmp_path / "b", range(4), mot__hota=lambda seed: 89.0 + 20.0 * noise[1, seed])
    assert run_command_line(["compare", a, b]) == exit_codes.UNDECIDED
    told = " ".join(capsys.readouterr().err.split())
    assert "Undecided" in told
    assert "more seeds would decide it" in told
    assert run_command_line(["compare", a, b, "--quiet", "--allow-undecided"]) == exit_codes.DONE


def test_the_time_of_a_step_is_judged_as_a_ratio_within_one_stress_test_only(tmp_path):
    def both(rows: pd.DataFrame) -> pd.DataFrame:
        slow = rows.assign(model="gmm", **{"timing.tracker_ms.p50": 15.0 + 0.1 * rows["seed"]})
        return pd.concat([rows.assign(**{"timing.tracker_ms.p50": 10.0}), slow])

    folder = edited(grid_folder(tmp_path / "a"), both)
    (time,) = (one for one in compared(f"{folder}@mmpf cvm", f"{folder}@mmpf gmm").verdicts if "timing" in one.metric)
    assert (time.a, time.verdict) == (1.0, WORSE)
    assert time.b == pytest.approx(1.545)
    shutil.copytree(folder, tmp_path / "copy")
    across = compared(f"{folder}@mmpf cvm", f"{tmp_path / 'copy'}@mmpf gmm")
    assert not any("timing" in verdict.metric for verdict in across.verdicts)
    assert any("time of a step is not judged" in note for note in across.notes)


@pytest.mark.parametrize("column", ["mismatch", "replay"])
def test_runs_of_other_mismatches_or_recordings_with_the_same_seed_are_other_pairs(column, tmp_path):
    def of_two(first: float):
        worlds = [{column: "one", "mot.hota": first}, {column: "two", "mot.hota": 1.0}]
        return lambda rows: pd.concat([rows.assign(**world) for world in worlds])

    folders = [edited(grid_folder(tmp_path / name), of_two(first)) for name, first in (("a", 1.0), ("b", 2.0))]
    verdict = next(one for one in compared(*folders).verdicts if one.metric == "mot.hota")
    assert (verdict.pairs, verdict.a, verdict.b) == (20, 1.0, 1.5)


def test_settings_that_were_varied_tell_runs_apart(tmp_path):
    def in_range(shift: float):
        near, far = ({"sensor.range_m": m, "mot.hota": hota + shift} for m, hota in ((40.0, 10.0), (80.0, 90.0)))
        return lambda rows: pd.concat([rows.assign(**near), rows.assign(**far)]).assign(**{"tracker.particles": 50})

    axes = {"vary": ("sensor.range_m=40,80", "tracker.particles = 50,100")}
    folders = [edited(grid_folder(tmp_path / f"{m}", range(4), **axes), in_range(m)) for m in (0.0, 1.0)]
    assert open_source(folders[0], "compare").axes == ("sensor.range_m", "tracker.particles")
    verdict = next(one for one in compared(*folders).verdicts if one.metric == "mot.hota")
    assert (verdict.pairs, verdict.difference) == (8, pytest.approx(1.0))


def test_the_command_exits_with_one_on_a_regression_and_writes_both_forms(tmp_path, capsys):
    a, b = grid_folder(tmp_path / "a"), grid_folder(tmp_path / "b", mot__hota=lambda seed: 0.5)
    assert run_command_line(["compare", b, "--baseline", a, "--json", "--markdown", str(tmp_path / "c.md")]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["regression"] is True
    assert {"metric", "a", "b", "difference", "ci95", "p", "verdict"} <= set(printed["verdicts"][0])
    assert "| HOTA in sight, % |" in (tmp_path / "c.md").read_text()
    assert "**worse**" in (tmp_path / "c.md").read_text()
    assert printed["outcome"] == "worse"
    assert run_command_line(["compare", a, b, "--quiet", "--tolerance", "0.9"]) == 0
    assert run_command_line(["compare", b, a, "--quiet"]) == 0


def without_metrics(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=[quantity.key for quantity in compared_quantities()])


def with_values(value: float, *metrics: str):
    names = list(metrics or [quantity.key for quantity in compared_quantities()])
    return lambda table: table.assign(**dict.fromkeys(names, value))


HOPELESS = {
    "all metrics nan": with_values(np.nan),
    "one metric nan": with_values(np.nan, "mot.hota"),
    "columns missing": without_metrics,
    "one column missing": lambda table: table.drop(columns="mot.hota"),
    "one run failed": lambda table: table.assign(succeeded=table["seed"] != 3),
    "few runs left": lambda table: table[table["seed"] < 3],
    "one other seed": lambda table: table[table["seed"] < 1].assign(seed=lambda rows: rows["seed"] + 50),
}


@pytest.mark.parametrize("change", HOPELESS.values(), ids=HOPELESS.keys())
def test_what_is_hopeless_is_undecided_and_never_passes(change, tmp_path, capsys):
    a = grid_folder(tmp_path / "a")
    b = edited(grid_folder(tmp_path / "b"), change)
    assert run_command_line(["compare", a, b, "--json"]) == exit_codes.UNDECIDED
    told = capsys.readouterr()
    assert "No worse" not in told.err
    assert json.loads(told.out)["reasons"]
    assert run_command_line(["compare", b, a, "--quiet"]) == exit_codes.UNDECIDED
    (tmp_path / "gate.toml").write_text('[metrics."mot.hota"]\nfloor = 90')
    assert run_command_line(["compare", b, a, "--quiet", "--gate", str(tmp_path / "gate.toml")]) == exit_codes.WORSE


def test_a_chosen_metric_that_neither_side_has_is_undecided(tmp_path):
    a = edited(grid_folder(tmp_path / "a"), HOPELESS["one column missing"])
    assert run_command_line(["compare", a, a, "--quiet"]) == exit_codes.DONE
    assert run_command_line(["compare", a, a, "--primary", "mot.hota,mot.idf1"]) == exit_codes.UNDECIDED


@pytest.mark.parametrize("cell", [{"succeeded": 0.5}, {"seed": -1}, {"variant": None}, {"density": -20.0}], ids=str)
def test_a_row_that_is_of_no_run_is_refused_in_one_line(cell, tmp_path, refused):
    a, b = (grid_folder(tmp_path / name) for name in "ab")
    assert next(iter(cell)) in refused("compare", a, edited(b, lambda table: table.assign(**cell)))


def test_a_tracker_whose_runs_all_failed_does_not_vanish_unseen(tmp_path):
    whole, lost, gone = (grid_folder(tmp_path / name) for name in ("whole", "lost", "gone"))
    for folder in (whole, lost):
        edited(folder, lambda table: pd.concat([table, table.assign(model="gmm")]))
    edited(lost, lambda table: table.assign(succeeded=table["model"] == "cvm"))
    assert run_command_line(["compare", whole, whole, "--quiet"]) == exit_codes.DONE
    for b in (lost, gone):
        comparison = compared(whole, b)
        assert comparison.outcome == "undecided"
        assert any("mmpf gmm" in reason for reason in comparison.reasons)
    assert run_command_line(["compare", f"{whole}@mmpf cvm", gone, "--quiet"]) == exit_codes.DONE


def test_an_older_baseline_without_a_metric_does_not_stop_the_others(tmp_path):
    a, b = (grid_folder(tmp_path / name) for name in "ab")
    older = edited(a, lambda table: table.drop(columns="mae.hidden.lon_m"))
    assert run_command_line(["compare", older, b, "--quiet"]) == exit_codes.DONE


@pytest.mark.parametrize("option", ["--markdown", "--html"])
def test_a_file_that_can_not_be_written_is_told_in_one_line(option, tmp_path, refused):
    a = grid_folder(tmp_path / "a")
    assert option in refused("compare", a, a, "--quiet", option, tmp_path / "no" / "such" / "x")


def test_a_wrong_call_is_answered_with_one_line(tmp_path, refused):
    a = grid_folder(tmp_path / "a")
    for arguments in ([a], [], [a, "missing"], [a, a, a], ["--suite", "nonsense", "--baseline", a]):
        refused("compare", *arguments)


@pytest.fixture
def echo_run(tmp_path) -> str:
    config = resolve_run_config(options={"tracker": ECHO})
    return str(run(config, out=tmp_path / "run", open_snapshots=observing(SteadyTraffic(steps=12))).folder)


def test_a_single_run_against_itself_differs_in_nothing(echo_run):
    verdicts = compared(echo_run, echo_run).verdicts
    assert {verdict.difference for verdict in verdicts if verdict.pairs} == {0.0}
    assert {verdict.verdict for verdict in verdicts if verdict.primary and verdict.pairs} == {NO_WORSE}
    a, b = (open_source(echo_run, "compare") for _ in range(2))
    rules = Rules(primary=tuple(quantity.key for quantity in compared_quantities()))
    every, _ = compare_runs(a, b, [evidence_of(each.folder, read_seen(a, b)[0]) for each in (a, b)], rules)
    assert all(each.same for each in every if each.pairs)


def test_what_the_second_single_run_lacks_is_wanting_and_has_no_value(echo_run, tmp_path):
    poorer = Path(shutil.copytree(echo_run, tmp_path / "poorer"))
    metrics = json.loads((poorer / "metrics.json").read_text())
    metrics["mot"]["hota"] = None
    (poorer / "metrics.json").write_text(json.dumps(metrics))
    with pytest.raises(InputError, match=r"metrics\.json was changed after it was written"):
        compared(echo_run, str(poorer))
    manifest = json.loads((poorer / "manifest.json").read_text())
    (poorer / "manifest.json").write_text(json.dumps(manifest | {"files_sha256": {}}))
    verdict = next(one for one in compared(echo_run, str(poorer)).verdicts if one.metric == "mot.hota")
    assert (verdict.verdict, verdict.pairs, verdict.regression) == (UNDECIDED, 0, False)
    assert verdict.a > 0.0
    assert np.isnan(verdict.b)
    assert verdict.wanting == "b has no value of it"


@pytest.fixture
def small_suite(monkeypatch, no_pictures) -> None:
    """Put a small grid on stand-in traffic, run in this process, in the standard suite's place."""
    request = GridRequest(densities="20", trackers=ECHO, seeds="3", duration_s=1.0)
    monkeypatch.setattr("harness.commands.actions.compare_sides.SUITES", {"standard": request})

    def run_here(cells, workers, timeout_s, on_row) -> None:
        InProcess()(cells, on_row)

    monkeypatch.setattr("harness.commands.actions.compare_sides.run_cells", run_here)


@pytest.mark.slow
def test_a_suite_is_recorded_and_checked_against_what_was_recorded(small_suite, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_command_line(["compare", "--suite", "standard", "--quiet"]) == 2
    assert "results/reference" in capsys.readouterr().err
    assert run_command_line(["compare", "--suite", "standard", "--record", "--quiet"]) == 0
    assert (tmp_path / "results/reference/standard/runs.parquet").is_file()
    assert run_command_line(["compare", "--suite", "standard", "--out", "again", "--quiet"]) == 0
    assert run_command_line(["compare", "again", "--baseline", "results/reference", "--json", "--quiet"]) == 0
    assert {verdict["pairs"] for verdict in json.loads(capsys.readouterr().out)["verdicts"]} >= {3}


IN_PLAIN_VIEW = ["in_plain_view.recall", "in_plain_view.worst_tenth"]


def test_recall_in_plain_view_and_that_of_the_worst_tenth_are_judged_unasked(tmp_path):
    a = grid_folder(tmp_path / "a", **{name.replace(".", "__"): wobbling(98.0) for name in IN_PLAIN_VIEW})
    b = grid_folder(tmp_path / "b", **{name.replace(".", "__"): wobbling(60.0, 1) for name in IN_PLAIN_VIEW})
    found = words(compared(a, b))
    assert [found[name] for name in IN_PLAIN_VIEW] == [WORSE, WORSE]
    listed = {verdict.metric for verdict in compared(a, b).verdicts if verdict.verdict == UNTESTED}
    assert {"in_plain_view.never_reported", "in_plain_view.dropped", "in_plain_view.stopped_recall"} <= listed
