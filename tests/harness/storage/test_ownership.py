import json
import os

import pytest

from harness.common.errors import InputError
from harness.storage import ownership
from harness.storage.ownership import EXPORT, LEDGER, RUN, STRESS


@pytest.fixture
def run(tmp_path):
    """Make a run's folder with a figure and an export in it."""
    folder = tmp_path / "run"
    (folder / "figures").mkdir(parents=True)
    (folder / "metrics.json").write_text("{}")
    (folder / "figures" / "scene.png").write_text("x")
    ownership.record_all(folder, RUN)
    (folder / "export" / "csv").mkdir(parents=True)
    (folder / "export" / "csv" / "truth.csv").write_text("x")
    ownership.record_all(folder / "export" / "csv", EXPORT)
    return folder


def test_what_this_program_made_is_removed_whole(run):
    ownership.check_replaceable(run, RUN)
    assert ownership.described(run) == f"{run}: a run, 5 files, 0.0 MB"
    ownership.remove(run)
    assert not run.exists()


@pytest.mark.parametrize("place", ["notes.txt", "figures/mine.png", "export/mine.csv", "export/csv/mine.csv", "sub/x"])
def test_a_users_file_makes_a_folder_irreplaceable_and_survives_its_removal(run, place):
    (run / place).parent.mkdir(exist_ok=True)
    (run / place).write_text("mine")
    with pytest.raises(InputError, match=f"holds {place}, which this program did not write"):
        ownership.check_replaceable(run, RUN)
    ownership.remove(run)
    assert (run / place).read_text() == "mine"
    assert {path.name for path in run.rglob("*") if path.is_file()} == {LEDGER, (run / place).name}


def test_a_run_within_a_run_is_a_result_of_its_own(run):
    inner = run / "inner"
    inner.mkdir()
    (inner / "metrics.json").write_text("{}")
    ownership.record_all(inner, RUN)
    with pytest.raises(InputError, match="holds inner/"):
        ownership.check_replaceable(run, RUN)


@pytest.mark.parametrize(
    "ledger",
    [
        *("", "[]", "{}", '{"program": "mmpf-harness", "kind": ["run"]}'),
        '{"program": "another", "kind": "run", "files": ["metrics.json"]}',
        '{"program": "mmpf-harness", "kind": "else"}',
        b"\xff\xfe",
    ],
)
def test_no_folder_is_taken_for_this_programs_by_a_file_that_only_looks_so(run, ledger):
    content = ledger if isinstance(ledger, bytes) else ledger.encode()
    (run / LEDGER).write_bytes(content)
    with pytest.raises(InputError, match="was not made by this program"):
        ownership.check_replaceable(run, RUN)


def test_a_folder_of_another_kind_a_link_and_a_file_are_refused(run, tmp_path):
    with pytest.raises(InputError, match="is a run, not a stress test"):
        ownership.check_replaceable(run, STRESS)
    (tmp_path / "link").symlink_to(run)
    with pytest.raises(InputError, match="is a link"):
        ownership.check_replaceable(tmp_path / "link", RUN)
    with pytest.raises(InputError, match="is a file"):
        ownership.check_replaceable(run / "metrics.json", RUN)


def test_a_ledger_reaches_nothing_outside_of_its_folder_and_through_no_link(run, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious").write_text("x")
    (run / "link").symlink_to(outside)
    names = ["../outside/precious", str(outside / "precious"), "link/precious", "metrics.json"]
    (run / LEDGER).write_text(json.dumps({"program": ownership.PROGRAM, "kind": RUN, "files": names}))
    ownership.remove(run)
    assert (outside / "precious").exists()
    assert not (run / "metrics.json").exists()


def test_what_a_later_command_writes_is_entered_and_only_where_there_is_a_ledger(run, tmp_path):
    page = run / "report.html"
    page.write_text("x")
    assert ownership.strangers(run) == ["report.html"]
    ownership.add(run, [page])
    assert ownership.strangers(run) == []
    ownership.add(tmp_path, [tmp_path / "x"])
    assert os.listdir(tmp_path) == ["run"]
