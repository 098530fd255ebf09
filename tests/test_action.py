"""The action that compares a tracker with its baseline: its own shell lines, run on two folders."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text())
STEPS = {step["name"]: step for step in ACTION["runs"]["steps"]}


def run_step(name: str, folder: Path, **env: str) -> subprocess.CompletedProcess[str]:
    """Run a step where `python -m harness` is a stand-in that notes its words and ends with $CODE."""
    stand_in = folder / "bin" / "python"
    stand_in.parent.mkdir(exist_ok=True)
    stand_in.write_text(
        f"#!{sys.executable}\n"
        "import json, os, pathlib, sys\n"
        "words = sys.argv[3:]\n"
        "pathlib.Path(os.environ['NOTES']).open('a').write(json.dumps(words) + '\\n')\n"
        "if '--summary' in words: pathlib.Path(words[words.index('--summary') + 1]).write_text('the summary')\n"
        "if words[0] == 'stress': pathlib.Path(words[words.index('--out') + 1]).mkdir()\n"
        "sys.exit(int(os.environ['CODE']) if words[0] == 'compare' else 0)\n"
    )
    stand_in.chmod(0o755)
    given = {"CODE": "0", "NOTES": str(folder / "notes"), "GITHUB_OUTPUT": str(folder / "output")}
    given |= {"GITHUB_STEP_SUMMARY": str(folder / "summary"), "PATH": f"{stand_in.parent}:{os.environ['PATH']}"}
    words = ["bash", "-c", STEPS[name]["run"]]
    return subprocess.run(words, cwd=folder, env=given | env, capture_output=True, text=True, check=False)


def compared(folder: Path, **env: str) -> subprocess.CompletedProcess[str]:
    given = {"TRACKERS": "t:T", "HEAD_FOLDER": "b", "BASE_FOLDER": "a", "BASE_REF": "x", "STRESS": "--seeds 2"}
    assert run_step("Run", folder, **given).returncode == 0
    return run_step("Compare", folder, **{"COMPARE": "--gate gate.toml", "UNDECIDED": "pass"} | env)


@pytest.mark.parametrize(
    ("code", "undecided", "ends", "verdict"),
    [
        ("0", "pass", 0, "no worse"),
        ("1", "pass", 1, "worse"),
        ("4", "pass", 0, "undecided"),
        ("4", "fail", 4, "undecided"),
    ],
)
def test_the_verdict_decides_how_the_action_ends(code, undecided, ends, verdict, tmp_path):
    assert compared(tmp_path, CODE=code, UNDECIDED=undecided).returncode == ends
    assert (tmp_path / "output").read_text() == f"verdict={verdict}\n"
    assert (tmp_path / "summary").read_text() == "the summary"


@pytest.mark.parametrize("code", ["2", "3", "70"])
def test_a_failed_comparison_fails_the_action_without_a_verdict(code, tmp_path):
    assert compared(tmp_path, CODE=code).returncode == int(code)
    assert not (tmp_path / "output").exists()


def test_finished_folders_are_compared_in_order_with_the_given_options(tmp_path):
    compared(tmp_path)
    (words,) = map(json.loads, (tmp_path / "notes").read_text().splitlines())
    assert words[:5] == ["compare", "a", "b", "--gate", "gate.toml"]


def test_without_folders_head_and_base_are_run(tmp_path):
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for words in (["init", "-q"], ["commit", "-q", "--allow-empty", "-m", "1"]):
        subprocess.run([*git, *words], cwd=tmp_path, check=True)
    given = {"TRACKERS": "t:T", "HEAD_FOLDER": "", "BASE_FOLDER": "", "BASE_REF": "HEAD", "STRESS": "--seeds 2"}
    assert run_step("Run", tmp_path, **given).returncode == 0
    head, base = map(json.loads, (tmp_path / "notes").read_text().splitlines())
    assert head[:5] == base[:5] == ["stress", "--seeds", "2", "--trackers", "t:T"]
    assert [Path(words[6]).name for words in (head, base)] == ["head", "base"]


def test_every_shell_step_stops_at_the_first_failure():
    assert all(step["run"].startswith("set -euo pipefail\n") for step in STEPS.values() if "run" in step)
