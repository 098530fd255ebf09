"""Run commands at two revisions and tell whether what they write and print is the same.

For a change that is meant to move code and not results: ``python .ci/same_results.py OLD [NEW]``. Without NEW, the
working tree is taken. Exit code 1 if anything differs. The commands are those of ``same_results_commands.py``; what is
left out of the comparison, and why, stands in ``same_results_digests.py``. ``--only runs,help`` takes groups or single
commands, with the earlier ones that they need. ``--keep FILE`` keeps what is known of a revision, so that it is run
once. A command that ends with another exit code at one revision, for example since an option is new, is named with what
it says at both.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from same_results_commands import COMMANDS, SLOW, needed
from same_results_digests import masked, of_folder, of_text
from same_results_recordings import write_recordings

ROOT = Path(__file__).resolve().parents[1]
LINES_SHOWN = 12
Digests = dict[str, dict[str, str]]
RUNNING = "same-results-running"
SAID = "says"
"""Key of a command's last line of errors: shown where the exit codes differ, and not compared."""


def main() -> int:
    """Compare two revisions and print one line a command."""
    words = _arguments()
    chosen = needed(words.only.split(",") if words.only else [name for name in COMMANDS if name not in SLOW])
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder) if words.results is None else words.results.resolve()
        work.mkdir(parents=True, exist_ok=True)
        old = _of_revision(words.old, chosen, work / "old", words.keep)
        new = (
            _of_revision(words.new, chosen, work / "new", words.keep)
            if words.new
            else _digests(ROOT, chosen, work / "new", "working tree")
        )
    for name in chosen:
        verdict = _verdict(old[name], new[name])
        different += verdict != "same"
        print(f"{name:24} {len(old[name]):4} parts  {verdict}")  # noqa: T201
    print(f"{different} of {len(chosen)} commands differ" if different else f"all {len(chosen)} commands: same")  # noqa: T201
    return int(different > 0)


def _arguments() -> argparse.Namespace:
    groups = ", ".join(dict.fromkeys(command.group for command in COMMANDS.values()))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old")
    parser.add_argument("new", nargs="?", help="a revision; the working tree if left out")
    parser.add_argument("--only", default="", help=f"groups or commands, with commas between; groups: {groups}")
    parser.add_argument("--keep", type=Path, help="JSON file of what is known of revisions; read, and added to")
    parser.add_argument("--results", type=Path, help="new folder in which the commands' results stay, to look at")
    return parser.parse_args()


def _verdict(old: dict[str, str], new: dict[str, str]) -> str:
    if old["exit code"] != new["exit code"]:
        ends = (f"exit code {one['exit code']}: {one[SAID] or 'no error'}" for one in (old, new))
        return "DIFFERENT: " + " -> ".join(ends)
    unlike = sorted(part for part in (old.keys() | new.keys()) - {SAID} if old.get(part) != new.get(part))
    more = f" and {len(unlike) - LINES_SHOWN} more" if len(unlike) > LINES_SHOWN else ""
    return f"DIFFERENT: {', '.join(unlike[:LINES_SHOWN])}{more}" if unlike else "same"


def _of_revision(revision: str, names: list[str], work: Path, keep: Path | None) -> Digests:
    """Return a revision's digests, of which only those are made that are not in the file yet."""
    commit = _git("rev-parse", f"{revision}^{{commit}}")
    recordings = write_recordings(work)
    kept = json.loads(keep.read_text()) if keep is not None and keep.exists() else {}
    known: Digests = {name: kept[key] for name in names if (key := _key(commit, recordings, name)) in kept}
    missing = [name for name in names if name not in known]
    if missing:
        # Reached anew from the checkout: what a missing command needs is run again.
        _git("clone", "--quiet", str(ROOT), str(work / "tree"))
        _git("checkout", "--quiet", commit, folder=work / "tree")
        made = _digests(work / "tree", needed(missing), work / "results", commit[:8])
        known |= {name: made[name] for name in missing}
    if keep is not None:
        keep.write_text(json.dumps(kept | {_key(commit, recordings, name): known[name] for name in names}, indent=0))
    return known


def _key(commit: str, recordings: str, name: str) -> str:
    return f"{commit} {recordings} {name}: {' '.join(COMMANDS[name].words)}"


def _git(*words: str, folder: Path = ROOT) -> str:
    return subprocess.run(["git", *words], check=True, cwd=folder, capture_output=True, text=True).stdout.strip()


def _digests(tree: Path, names: list[str], out: Path, label: str) -> Digests:
    """Run commands one after the other in a folder, where they find each other's results by name.

    The folder is the same for all revisions: names of a grid's cells have a digest of the recordings' paths.
    """
    kept, out = out, Path(tempfile.gettempdir()) / RUNNING
    out.mkdir()
    write_recordings(out)
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MMPF_", "HARNESS_"))}
    environment |= {"PYTHONPATH": str(tree), "COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"}
    digests = {}
    for name in names:
        begin = time.perf_counter()
        if "--out" not in COMMANDS[name].words:
            (out / name).mkdir()  # for the files that it is told to write there
        command = [sys.executable, "-m", "harness", *COMMANDS[name].words]
        ended = subprocess.run(command, cwd=out, env=environment, capture_output=True, text=True, check=False)
        paths = (str(out), str(tree))
        said = masked(ended.stderr, paths).strip().splitlines()
        digests[name] = {
            "exit code": str(ended.returncode),
            SAID: said[-1][:300] if said else "",
            "stdout": of_text(masked(ended.stdout, paths)),
            "stderr": of_text("\n".join(said)),
            **of_folder(out / (COMMANDS[name].folder or name), paths),
        }
        print(f"{label}: {name}: {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)  # noqa: T201
    shutil.move(out, kept)
    return digests


if __name__ == "__main__":
    sys.exit(main())
