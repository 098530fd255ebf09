"""Reference tables are made by one command from a clean tree, taken up again where that is honest, and checked."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from harness.common.errors import InputError

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / ".ci"))
from reference import (  # noqa: E402
    FOLDER,
    Reference,
    confirm,
    differences,
    made_as_listed,
    made_here,
    make_reference,
    reference_named,
    references,
    stale_parts,
)  # fmt: skip

TABLE = Reference("table", "A table.", ("stress", "--seeds", "1"))


def git(root: Path, *words: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", "-C", str(root), *who, *words], check=True, capture_output=True)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a small source tree under git, with a reference in it."""
    for name in ("mmpf/a.py", "harness/b.py", "networks/c.xml", "constraints.txt", "README.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1\n")
    (tmp_path / ".gitignore").write_text("results/*\n!results/reference/\n")
    old = tmp_path / FOLDER / "table"
    old.mkdir(parents=True)
    (old / "old.md").write_text("old\n")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-qm", "1")
    return tmp_path


class Stress:
    """Stands for the command: writes what a stress test leaves."""

    def __init__(self) -> None:
        self.calls: list[list[str]] = []

    def __call__(self, words: list[str], out: Path) -> None:
        self.calls.append(words)
        (out / "runs").mkdir(parents=True, exist_ok=True)
        (out / "runs" / "row.json").write_text("{}")
        (out / "report.html").write_text("")
        (out / ".ledger.json").write_text("{}")
        (out / "table.md").write_text(f"{len(self.calls)}, [look](kept/a/report.html#t=1), [b](b.md)\n")
        (out / "manifest.json").write_text(json.dumps({"git_revision": "x-dirty", "command": "harness stress"}))


def test_a_reference_holds_tables_and_the_revision_and_the_one_command_that_makes_it(tree: Path) -> None:
    kept = make_reference(TABLE, tree, Stress())
    assert sorted(file.name for file in kept.iterdir()) == ["manifest.json", "table.md"]
    assert (kept / "table.md").read_text() == "1, not kept, [b](b.md)\n"
    manifest = json.loads((kept / "manifest.json").read_text())
    head = subprocess.run(["git", "-C", str(tree), "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    assert manifest["git_revision"] == head.stdout.strip()
    assert manifest["command"] == "python .ci/reference.py table"
    assert manifest["that_runs"] == "python -m harness stress --seeds 1"


def test_a_second_reference_is_made_while_the_first_waits_to_be_committed(tree: Path) -> None:
    make_reference(TABLE, tree, Stress())
    make_reference(Reference("other", "", ("study", "x")), tree, Stress())


@pytest.mark.parametrize("name", ["README.md", "mmpf/new.py"])
def test_a_tree_with_changes_makes_no_reference(tree: Path, name: str) -> None:
    (tree / name).write_text("2\n")
    with pytest.raises(InputError, match=rf"clean tree, but {name}"):
        make_reference(TABLE, tree, Stress())


def test_runs_are_gone_on_with_after_a_change_of_pages_but_not_of_sources(tree: Path) -> None:
    stress = Stress()
    make_reference(TABLE, tree, stress)
    (tree / "README.md").write_text("2\n")
    git(tree, "commit", "-aqm", "2")
    make_reference(TABLE, tree, stress)
    (tree / "mmpf" / "a.py").write_text("2\n")
    git(tree, "add", "-A")
    git(tree, "commit", "-qm", "3")
    with pytest.raises(InputError, match="begun with other sources; remove it"):
        make_reference(TABLE, tree, stress)
    assert len(stress.calls) == 2


def write_tables(folder: Path, **rows: dict[str, float]) -> None:
    """Write a table of one run into a folder of each name."""
    for name, row in rows.items():
        (folder / name).mkdir()
        pd.DataFrame([row]).to_parquet(folder / name / "runs.parquet")


def test_only_times_may_differ_between_two_makings(tmp_path: Path) -> None:
    usual = {"mot.hota": 90.0, "timing.total_s": 1.0, "mae.lon_m": float("nan")}
    write_tables(tmp_path, a=usual, b=usual | {"timing.total_s": 2.0}, c=usual | {"mot.hota": 90.5})
    assert not differences(tmp_path / "a", tmp_path / "b")
    (found,) = differences(tmp_path / "a", tmp_path / "c")
    assert str(found) == "runs.parquet, row 0, mot.hota: committed 90.0, remade 90.5"


def test_on_another_kind_of_processor_only_traffic_and_detections_have_to_be_the_same(tmp_path: Path) -> None:
    usual = {"mot.hota": 90.0, "traffic.flow_veh_per_h": 1.0}
    write_tables(tmp_path, a=usual, b=usual | {"mot.hota": 90.5}, c=usual | {"traffic.flow_veh_per_h": 2.0})
    assert not differences(tmp_path / "a", tmp_path / "b", world_only=True)
    assert len(differences(tmp_path / "a", tmp_path / "c", world_only=True)) == 1
    (tmp_path / "a" / "manifest.json").write_text(json.dumps({"machine": {"kind": "another"}}))
    assert not made_here(tmp_path / "a")


def test_what_a_driver_would_do_is_held_together_only_where_the_committed_making_asked_one(tmp_path: Path) -> None:
    usual = {"mot.hota": 90.0}
    asked = usual | {"decisions.missed": 1.0, "conflicts.n": 9.0}
    write_tables(tmp_path, a=usual, b=asked, c=asked | {"decisions.missed": 2.0})
    assert not differences(tmp_path / "a", tmp_path / "b")
    assert len(differences(tmp_path / "b", tmp_path / "c")) == 1
    assert len(differences(tmp_path / "b", tmp_path / "a")) == 2


def test_a_table_that_was_not_made_differs_whole(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    pd.DataFrame({"mot.hota": [1.0, 2.0]}).to_parquet(tmp_path / "a" / "runs.parquet")
    assert len(differences(tmp_path / "a", tmp_path / "b")) == 2


def test_a_misspelt_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(InputError, match="do you mean trackers"):
        reference_named("traker", ROOT)


@pytest.mark.parametrize("reference", references(ROOT).values(), ids=lambda reference: reference.name)
def test_committed_tables_are_made_with_the_options_that_the_list_tells(reference: Reference) -> None:
    folder = ROOT / FOLDER / reference.name
    assert not folder.is_dir() or made_as_listed(reference, folder)


@pytest.mark.slow
def test_the_small_reference_remade_is_the_committed_one() -> None:
    words = [sys.executable, ".ci/reference.py", "small", "--check", "--workers", "1", "--quiet"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_a_table_that_older_code_made_is_named_with_what_changed(tree: Path) -> None:
    kept = make_reference(TABLE, tree, Stress())
    assert stale_parts(TABLE, tree) == []
    manifest = json.loads((kept / "manifest.json").read_text())
    manifest["code_sha256"]["harness/sensor"] = "0"
    (kept / "manifest.json").write_text(json.dumps(manifest))
    assert stale_parts(TABLE, tree) == ["harness/sensor"]
    assert stale_parts(Reference("other", "Not made.", ("stress",)), tree) == []


def test_a_table_of_which_some_runs_are_made_again_and_the_same_is_of_the_present_code(tree: Path) -> None:
    def runs(*hotas: float, net: str = "9") -> Callable[[list[str], Path], None]:
        def make(words: list[str], out: Path) -> None:
            out.mkdir(parents=True, exist_ok=True)
            rows = {"net": net, "demand": None, "seed": range(len(hotas)), "mot.hota": hotas, "timing.x": id(words)}
            pd.DataFrame(rows).head(1 if "1" in words else 2).to_parquet(out / "runs.parquet")

        return make

    two_runs = Reference("table", "A table.", ("stress",), some=("--seeds", "1"))
    manifest = make_reference(two_runs, tree, runs(80.0, 90.0)) / "manifest.json"
    git(tree, "add", "-A")
    git(tree, "commit", "-qm", "2")
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"code_sha256": {"mmpf": "0"}}))
    assert confirm(two_runs, tree, runs(81.0, 90.0))
    with pytest.raises(InputError, match="has no run of 9 - made again"):
        confirm(two_runs, tree, runs(80.0, 90.0, net="8"))
    assert "mmpf" in stale_parts(two_runs, tree)
    assert confirm(two_runs, tree, runs(80.0), runs(81.0))
    assert not confirm(two_runs, tree, runs(70.0), runs(70.0))
    assert not confirm(two_runs, tree, runs(80.0, 0.0))
    assert not stale_parts(two_runs, tree)
    assert json.loads(manifest.read_text())["confirmed"]["runs_made_again"] == 1
    git(tree, "commit", "-aqm", "3")
    make_reference(two_runs, tree, runs(80.0, 90.0))
    assert "confirmed" not in json.loads(manifest.read_text()), "it is made of the present code itself"
