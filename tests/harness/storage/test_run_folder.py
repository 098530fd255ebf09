import json
import os
import platform
import subprocess
import sys

import pandas as pd
import pytest

from harness.common.errors import InputError
from harness.storage import run_folder as runfolder
from harness.storage.ownership import LEDGER
from harness.storage.tables import write_table


def test_a_finished_folder_gets_its_name_only_at_the_end(tmp_path):
    pending = runfolder.open_folder(tmp_path / "run", "x", force=False)
    assert not (tmp_path / "run").exists()
    (pending.path / "file").write_text("x")
    assert pending.finish() == tmp_path / "run"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]


def test_an_unfinished_folder_says_so(tmp_path):
    pending = runfolder.open_folder(tmp_path / "run", "x", force=False)
    assert pending.leave_incomplete().name == "run.incomplete"
    again = runfolder.open_folder(tmp_path / "run", "x", force=False)
    assert again.leave_incomplete().name == "run.incomplete"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.incomplete"]


def test_only_what_surely_is_a_dead_runs_folder_is_removed(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    here = platform.node()
    kept = [
        f".run.running-{os.getpid()}@{here}",  # a run in this process
        f".run.running-{os.getppid()}@{here}",  # a run in another
        f".run.running-{gone.pid}@another-machine",  # on a shared disk
        f".run.running-{gone.pid}",
        f"run.running-{gone.pid}@{here}",
        f".mine.running-{gone.pid}@{here}",  # holds no run
    ]
    for name in kept:
        (tmp_path / name).mkdir()
        (tmp_path / name / (runfolder.CONFIG if "mine" not in name else "precious")).touch()
    left = tmp_path / f".left.running-{gone.pid}@{here}"
    left.mkdir()
    runfolder.open_folder(tmp_path / "new", "x", force=False).discard()
    assert not left.exists()
    assert {entry.name for entry in tmp_path.iterdir()} == set(kept)


def test_a_run_that_was_being_replaced_when_the_command_was_killed_is_there_again(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    (moved := tmp_path / f".x.replaced-{gone.pid}@{platform.node()}").mkdir()
    (moved / runfolder.CONFIG).write_text("mine")
    runfolder.open_folder(tmp_path / "new", "x", force=False).discard()
    assert (tmp_path / "x" / runfolder.CONFIG).read_text() == "mine"


def test_default_names_never_collide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [runfolder.open_folder(None, "a-run", force=False).finish().name for _ in range(3)]
    assert names == ["a-run", "a-run-2", "a-run-3"]
    with pytest.raises(InputError, match=r"^`force`: it replaces the run in `out`, and there is none"):
        runfolder.open_folder(None, "a-run", force=True)


def test_a_run_that_ends_second_does_not_replace_the_first(tmp_path):
    pending = runfolder.open_folder(tmp_path / "run", "x", force=False)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "precious").write_text("x")
    assert pending.finish().name == "run-2"
    assert (tmp_path / "run" / "precious").exists()


def test_force_replaces_a_run_and_nothing_else(tmp_path):
    run, home = tmp_path / "run", tmp_path / "home"
    earlier = runfolder.open_folder(run, "x", force=False)
    (earlier.path / "old").write_text("x")
    assert earlier.replaced is None
    earlier.finish()
    again = runfolder.open_folder(run, "x", force=True)
    assert again.replaced == f"{run}: a run, 2 files, 0.0 MB"
    again.finish()
    assert [entry.name for entry in run.iterdir()] == [LEDGER]
    home.mkdir()
    for name in (runfolder.MANIFEST, runfolder.CONFIG, "precious"):
        (home / name).write_text("{}")
    with pytest.raises(InputError, match="was not made by this program"):
        runfolder.open_folder(home, "x", force=True)
    assert (home / "precious").exists()


def test_a_second_run_into_the_same_folder_is_refused_while_the_first_lasts(tmp_path):
    first = runfolder.open_folder(tmp_path / "run", "x", force=False)
    with pytest.raises(InputError, match="another process is writing"):
        runfolder.open_folder(tmp_path / "run", "x", force=False)
    runfolder.open_folder(tmp_path / "other", "x", force=False).discard()
    first.finish()
    second = runfolder.open_folder(tmp_path / "run", "x", force=True)
    with pytest.raises(InputError, match="another process is writing"):
        runfolder.open_folder(tmp_path / "run", "x", force=True)
    second.discard()
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]


def test_what_a_user_puts_into_a_run_while_it_is_being_replaced_survives(tmp_path):
    runfolder.open_folder(tmp_path / "run", "x", force=False).finish()
    replacing = runfolder.open_folder(tmp_path / "run", "x", force=True)
    (tmp_path / "run" / "notes.txt").write_text("mine")
    assert replacing.finish().name == "run-2"
    assert (tmp_path / "run" / "notes.txt").read_text() == "mine"


def test_an_incomplete_folder_with_a_users_files_is_not_replaced(tmp_path):
    left = runfolder.open_folder(tmp_path / "run", "x", force=False).leave_incomplete()
    (left / "notes.txt").write_text("mine")
    assert runfolder.open_folder(tmp_path / "run", "x", force=False).leave_incomplete().name == "run.incomplete-2"
    assert (left / "notes.txt").exists()


@pytest.mark.parametrize("manifest", [None, "", "[]", "{}", '{"status": "interrupted"}'])
def test_only_a_finished_run_counts_as_one(tmp_path, manifest):
    if manifest is not None:
        (tmp_path / runfolder.MANIFEST).write_text(manifest)
    with pytest.raises(InputError, match="`replay`"):
        runfolder.read_manifest(tmp_path, "replay")
    (tmp_path / runfolder.MANIFEST).write_text(json.dumps({"status": runfolder.COMPLETE}))
    assert runfolder.read_manifest(tmp_path, "replay")["status"] == runfolder.COMPLETE


def test_a_truncated_table_is_told(tmp_path):
    path = tmp_path / "t.parquet"
    write_table(pd.DataFrame({"a": range(1000)}), path)
    assert len(runfolder.read_table(tmp_path, "t.parquet", "replay", ["a"])) == 1000
    with pytest.raises(InputError, match="no column b"):
        runfolder.read_table(tmp_path, "t.parquet", "replay", ["a", "b"])
    whole = path.read_bytes()
    for length in (0, 3, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"t\.parquet: broken, or no table of a run"):
            runfolder.read_table(tmp_path, "t.parquet", "replay", ["a"])
    path.unlink()
    with pytest.raises(InputError, match=r"t\.parquet is missing"):
        runfolder.read_table(tmp_path, "t.parquet", "replay", ["a"])


def test_the_same_table_gives_the_same_bytes_and_an_empty_one_its_types(tmp_path):
    table = pd.DataFrame({"n": [1, 2], "name": ["a", ""]}).astype({"name": object})
    for name in ("one", "two"):
        write_table(table, tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    write_table(table.iloc[:0], tmp_path / "empty")
    read = pd.read_parquet(tmp_path / "empty")
    assert list(read) == ["n", "name"]
    assert read["n"].dtype == "int64"
    assert pd.api.types.is_string_dtype(read["name"])
