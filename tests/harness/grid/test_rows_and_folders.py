"""Rows of a grid as files and columns, its folder, and the command that makes a run again."""

import os

import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.config.model import RunConfig
from harness.grid.cells import assemble, command_of
from harness.grid.grid import GridRequest, plan_grid
from harness.running.resolve import with_usual_traffic
from harness.storage import ownership
from harness.storage.grid_folder import check_same_grid, flattened, open_grid_folder, read_rows, write_row

GRID = plan_grid(GridRequest(densities="20", seeds="2", trackers="pmbm", vary=("sensor.range_m=40,60",)))


def test_nested_tables_lists_and_intervals_become_columns():
    table = {"a": 1, "b": {"c": 2, "d_ci95": (3, 4), "e": [{"f": 5}, 6]}, "g_ci95": None, "h": None, "i": "x"}
    assert flattened(table) == {
        "a": 1, "b.c": 2, "b.d_ci95.low": 3, "b.d_ci95.high": 4, "b.e.0.f": 5, "b.e.1": 6, "g_ci95.low": None,
        "g_ci95.high": None, "h": None, "i": "x",
    }  # fmt: skip


def test_a_row_reads_back_unless_it_is_damaged(tmp_path):
    good = {"succeeded": True, "error": None, "net": "a", "mot.hota": 1.5, "drive.ended": "x", "n": 3}
    write_row(tmp_path, "good", good)
    damaged = [
        "", "[]", "{}", '{"succeeded": 1, "error": null}', '{"succeeded": true}', '{"error": null}',
        '{"succeeded": true, "error": 5}', '{"succeeded": true, "error": null, "mot.hota": "much"}',
        '{"succeeded": true, "error": null, "mot.hota": [1]}',
    ]  # fmt: skip
    for place, text in enumerate(damaged):
        (tmp_path / f"{place}.json").write_text(text)
    write_row(tmp_path, "last", good | {"succeeded": False})
    keys = [*map(str, range(len(damaged))), "good", "missing", "last"]
    assert read_rows(tmp_path, keys) == {"good": good, "last": good | {"succeeded": False}}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_row(tmp_path, "nan", {"a": float("nan")})


def test_the_table_of_a_grid_has_its_columns_in_a_fixed_order_and_of_fixed_types():
    rows = {run.key: run.identity() | {"succeeded": True, "error": None, "total_s": 1} for run in GRID.runs}
    rows[GRID.runs[1].key] |= {"z": 5, "a": None, "drive.ended": "late", "succeeded": False, "error": "it broke"}
    table = assemble(GRID, rows)
    assert list(table) == [
        "net", "density", "demand", "tracker", "variant", "model", "update", "seed", "sensor.range_m", "succeeded",
        "error", "total_s", "a", "drive.ended", "z",
    ]  # fmt: skip
    assert table["seed"].tolist() == [0, 1, 0, 1]
    assert table["sensor.range_m"].tolist() == [40.0, 40.0, 60.0, 60.0]
    assert {name: str(table[name].dtype) for name in ("a", "z", "density", "seed", "succeeded", "demand", "error")} == {
        "a": "float64", "z": "float64", "density": "float64", "seed": "int64", "succeeded": "bool", "demand": "object",
        "error": "object",
    }  # fmt: skip
    assert table["error"].tolist() == [None, "it broke", None, None]
    assert table["drive.ended"].tolist() == [None, "late", None, None]
    assert table["demand"].tolist() == [None] * 4


def test_a_folder_is_taken_once_and_left_as_a_grids(tmp_path):
    out = tmp_path / "some" / "grid"
    with open_grid_folder(out, False) as rows:
        assert rows == out / "runs"
        assert ownership.kind_of(out) == ownership.STRESS
        with pytest.raises(InputError, match="another process is writing"), open_grid_folder(out, True):
            pass
        (rows / ".a.json.12.partial").touch()
        (out / ".b.json.12.partial").touch()
        (rows / "c.json").touch()
    with open_grid_folder(out, True) as rows:
        assert [path.name for path in rows.iterdir()] == ["c.json"]
    assert not list(out.glob("*.partial")) + list(out.glob(".b*"))
    with pytest.raises(InputError) as caught, open_grid_folder(out, False):
        pass
    assert str(caught.value) == f"`out`: {out} exists; add `resume` to go on with it, or choose another folder"


def refused(out, kind=ownership.STRESS) -> str:
    with pytest.raises(InputError) as caught, open_grid_folder(out, True, kind):
        pass
    return str(caught.value)


def test_what_is_no_grids_folder_is_told_with_why(tmp_path):
    file, grid, other = tmp_path / "file", tmp_path / "grid", tmp_path / "other"
    file.touch()
    assert refused(file) == f"`out`: {file} is a file; choose another folder"
    other.mkdir()
    (other / "thesis.tex").touch()
    word = ownership.plain(ownership.STRESS)
    assert refused(other) == f"`out`: {other} is not a {word}'s folder; choose another folder"
    with open_grid_folder(grid, False):
        pass
    assert refused(grid, ownership.RUN) == (
        f"`out`: {grid} is not a {ownership.plain(ownership.RUN)}'s folder; choose another folder"
    )
    (grid / "runs" / "a.json").symlink_to(file)
    assert refused(grid).startswith(f"`out`: {grid / 'runs' / 'a.json'} is a link")
    (grid / "runs" / "a.json").unlink()
    (grid / "runs" / "folder").mkdir()
    assert refused(grid) == f"`out`: {grid / 'runs' / 'folder'} is no file of a {word}; move it away"


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is refused to root")
def test_a_folder_that_may_not_be_written_is_told(tmp_path):
    tmp_path.chmod(0o500)
    assert f"`out`: can't write {tmp_path / 'out'}: " in refused(tmp_path / "out")


def test_a_grid_must_cover_what_its_folder_holds(tmp_path):
    rows = tmp_path / "runs"
    rows.mkdir()
    for key in "abc":
        (rows / f"{key}.json").touch()
    check_same_grid(tmp_path, rows, set("abcd"))
    with pytest.raises(InputError) as caught:
        check_same_grid(tmp_path, rows, set("a"))
    assert str(caught.value) == (
        f"`out`: {tmp_path} holds 2 runs of another grid, which this one would leave out; choose another folder or the "
        f"options that {tmp_path / 'grid.json'} tells"
    )
    table = tmp_path / "runs.parquet"
    pd.DataFrame({"x": range(3)}).to_parquet(table)
    check_same_grid(tmp_path, rows, set("abcd"))
    pd.DataFrame({"x": range(4)}).to_parquet(table)
    check_same_grid(tmp_path, rows, set("abc"))
    with pytest.raises(InputError) as caught:
        check_same_grid(tmp_path, rows, set("abcd"))
    assert str(caught.value) == f"`out`: runs in {table} have no files in {rows} any more; choose another folder"
    table.write_text("broken")
    check_same_grid(tmp_path, rows, set("abcd"))


def test_the_command_of_a_run_says_what_is_not_a_default_and_always_its_traffic_and_seed():
    replayed = {"tracker": {"name": "mmpf", "model": "cvm", "particles": 7}, "replay": "x/y.csv"}
    content = {
        "seed": 3,
        "traffic": {"net": "a b", "density": 20.0, "duration_s": 9.5},
        "sensor": {"profile": "radar", "overrides": {"range_m": 40, "name_of": "some_word", "odd": "a-b", "no": "nan"}},
        "tracker": {"name": "pmbm", "options": {"x": {"y": [1, 2]}, "truth": True, "word": "true"}},
    }
    assert [command_of(with_usual_traffic(RunConfig.model_validate(each))) for each in ({}, replayed, content)] == [
        "python -m harness run --seed 0 --demand us101-0805",
        "python -m harness run --seed 0 --replay x/y.csv --demand us101-0805 --model cvm --particles 7",
        "python -m harness run --seed 3 --net 'a b' --density 20.0 --duration 9.5 --sensor radar --set "
        "sensor.overrides.range_m=40 --set sensor.overrides.name_of=some_word --set "
        "'sensor.overrides.odd=\"a-b\"' --set 'sensor.overrides.no=\"nan\"' --tracker pmbm --set "
        "'tracker.options.x.y=[1, 2]' --set tracker.options.truth=true --set 'tracker.options.word=\"true\"'",
    ]
