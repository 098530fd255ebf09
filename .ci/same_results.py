"""Run twelve commands at two revisions and tell whether traffic, detections, tracks and scores are the same bytes.

For a change that is meant to move code and not results: ``python .ci/same_results.py OLD [NEW]``. Without NEW, the
working tree is taken. Wall times, versions and paths are left out; everything else counts. Exit code 1 if anything
differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
RUN = ("run", "--duration", "6", "--quiet")
COMMANDS: dict[str, tuple[str, ...]] = {
    "lidar": (*RUN, "--seed", "1"),
    "radar": (*RUN, "--seed", "2", "--sensor", "radar", "--model", "idm"),
    "camera": (*RUN, "--seed", "3", "--sensor", "camera", "--model", "cvm", "--density", "45"),
    "paper": (*RUN, "--seed", "4", "--update", "max_likelihood", "--model", "cam"),
    "short": (*RUN, "--seed", "5", "--model", "gmm-short", "--particles", "300", "--density", "20"),
    "jpda": (*RUN, "--seed", "6", "--tracker", "stonesoup-jpda"),
    "oracle": (*RUN, "--seed", "7", "--tracker", "oracle-kalman", "--demand", "us101-0820"),
    "replay": (*RUN, "--replay", "lidar", "--model", "gmm-lane-change", "--seed", "8"),
    "stress": (
        *("stress", "--densities", "15,45", "--seeds", "1", "--duration", "4", "--quiet"),
        *("--trackers", "mmpf,mmpf+update=max_likelihood,stonesoup-gnn"),
    ),
    "study": ("study", "lane-keeping", "--cases", "6", "--particles", "50", "--seeds", "0:1", "--quiet"),
    "study-lane-change": ("study", "lane-change", "--cases", "6", "--particles", "50", "--seeds", "0:1", "--quiet"),
    "ablation": ("study", "ablation", "--seeds", "0:1", "--quiet"),
}
SLOW = ("ablation",)
NOT_COMPARED = ("timing", "total_s", "manifest", "tracker_ms", "truth_ms", "sensor_ms", "realtime_factor", "_ms.")


def main() -> int:
    """Compare two revisions and print one line a command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old")
    parser.add_argument("new", nargs="?", help="a revision; the working tree if left out")
    parser.add_argument("--only", default="", help="commands with commas between")
    parser.add_argument("--slow", action="store_true", help="the slow ones too")
    words = parser.parse_args()
    chosen = [
        name
        for name in COMMANDS
        if (words.slow or name not in SLOW) and name in (words.only.split(",") if words.only else COMMANDS)
    ]
    different = 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        old = _digests(_checked_out(words.old, work / "old"), chosen, work / "results-old")
        new = _digests(_checked_out(words.new, work / "new") if words.new else ROOT, chosen, work / "results-new")
        for name in chosen:
            before, after = old[name], new[name]
            unlike = sorted(part for part in before.keys() | after.keys() if before.get(part) != after.get(part))
            different += bool(unlike or not before)
            verdict = f"DIFFERENT: {', '.join(unlike) or 'no results'}" if unlike or not before else "same"
            print(f"{name:18} {len(before):3} parts  {verdict}")  # noqa: T201
    return int(different > 0)


def _checked_out(revision: str, folder: Path) -> Path:
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    subprocess.run(["git", "checkout", "--quiet", revision], check=True, cwd=folder)
    return folder


def _digests(tree: Path, names: list[str], out: Path) -> dict[str, dict[str, str]]:
    out.mkdir()
    environment = os.environ | {"PYTHONPATH": str(tree)}
    digests = {}
    for name in names:
        words = [
            str(out / word) if word in COMMANDS and k and COMMANDS[name][k - 1] == "--replay" else word
            for k, word in enumerate(COMMANDS[name])
        ]
        command = [sys.executable, "-m", "harness", *words, "--out", str(out / name)]
        ended = subprocess.run(command, cwd=out, env=environment, capture_output=True, text=True, check=False)
        if ended.returncode not in {0, 1}:
            print(f"{tree}: {name}: {ended.stderr[-2000:]}", file=sys.stderr)  # noqa: T201
        digests[name] = dict(_parts(out / name))
    return digests


def _parts(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield a digest for each table's column and each number of each JSON file."""
    for path in sorted(folder.rglob("*")):
        where = path.relative_to(folder).as_posix()
        if path.suffix == ".parquet":
            table = pd.read_parquet(path)
            for column in table:
                if not any(word in str(column) for word in NOT_COMPARED):
                    content = table[column].to_csv(index=False).encode()
                    yield f"{where}:{column}", hashlib.sha256(content).hexdigest()
        elif path.suffix == ".json" and path.name != "manifest.json":
            for key, value in _leaves(json.loads(path.read_text())):
                if not any(word in key for word in NOT_COMPARED):
                    yield f"{where}:{key}", repr(value)


def _leaves(value: object, key: str = "") -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        if any(str(item).startswith("timing") for item in value.values()):
            return  # a curve of wall times
        for name, item in value.items():
            yield from _leaves(item, f"{key}.{name}")
    elif isinstance(value, list):
        for place, item in enumerate(value):
            yield from _leaves(item, f"{key}[{place}]")
    else:
        yield key, value


if __name__ == "__main__":
    sys.exit(main())
