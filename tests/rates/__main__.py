"""Scan rates on demand: ``python -m tests.rates --seeds 100,101,102 [--rates 2,10,20] [--folder runs]``.

SUMO drives once a seed, at 20 Hz. The harness's clock is then set to each rate in turn: the same vehicles are seen by
the same sensor more or less often. Prints what mmpf lacks of the oracle's HOTA at each rate, detection and association
apart.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import fmean

REPOSITORY = Path(__file__).parents[2]
RECORDED_HZ = 20.0
NO_TRACKER = "tests.harness.stand_ins:echo_tracker"
ORACLE, FILTER = "oracle-kalman", "mmpf"
SCORES = ("hota", "deta", "assa")


def main() -> int:
    """Make the runs that are missing and print the gaps."""
    parser = argparse.ArgumentParser(prog="python -m tests.rates", description=__doc__)
    parser.add_argument("--seeds", default="100,101,102")
    parser.add_argument("--rates", default="2,10,20", help="scans a second")
    parser.add_argument("--density", default="20")
    parser.add_argument("--duration", type=float, default=30.0, help="seconds")
    parser.add_argument("--folder", type=Path, help="where runs are kept and found again; by default a temporary one")
    chosen = parser.parse_args()
    rates = [float(rate) for rate in chosen.rates.split(",")]
    gaps: dict[float, list[dict[str, float]]] = {rate: [] for rate in rates}
    with tempfile.TemporaryDirectory() as temporary:
        folder = (chosen.folder or Path(temporary)).absolute()
        for seed in chosen.seeds.split(","):
            traffic = recorded(folder, seed, chosen.density, chosen.duration + 1.0)
            for rate in rates:
                of_oracle = scores(folder, traffic, seed, rate, chosen.duration, ORACLE)
                of_filter = scores(folder, traffic, seed, rate, chosen.duration, FILTER)
                gaps[rate].append({name: of_oracle[name] - of_filter[name] for name in SCORES})
                say(f"seed {seed}, {rate:g} Hz: {ORACLE} {of_oracle['hota']:.1f}, {FILTER} {of_filter['hota']:.1f}")
    for rate, found in gaps.items():
        lacks = ", ".join(f"{name} {fmean(gap[name] for gap in found):.1f}" for name in SCORES)
        say(f"{rate:g} Hz: {FILTER} lacks of {ORACLE}'s {lacks}")
    return 0


def recorded(folder: Path, seed: str, density: str, duration_s: float) -> Path:
    """Return a recording of simulated traffic as floating-car data."""
    run, fcd = folder / f"traffic-{seed}", folder / f"fcd-{seed}"
    if not run.exists():
        options = ("--net", "us101", "--density", density, "--duration", f"{duration_s:g}", "--seed", seed)
        command_line(RECORDED_HZ, "run", *options, "--tracker", NO_TRACKER, "--quiet", "--out", str(run))
    if not fcd.exists():
        command_line(RECORDED_HZ, "export", str(run), "--to", "fcd", "--out", str(fcd))
    return fcd / "fcd.xml"


def scores(folder: Path, traffic: Path, seed: str, rate: float, duration_s: float, tracker: str) -> dict[str, float]:
    """Return the scores in sight of a tracker that sees recorded traffic so often."""
    run = folder / f"{tracker}-{rate:g}-{seed}"
    if not run.exists():
        options = ("--net", "us101", "--replay", str(traffic), "--format", "fcd", "--duration", f"{duration_s:g}")
        command_line(rate, "run", *options, "--seed", seed, "--tracker", tracker, "--quiet", "--out", str(run))
    found: dict[str, float] = json.loads((run / "metrics.json").read_text())["mot"]
    return found


def command_line(rate: float, *words: str) -> None:
    """Run a command with the harness's clock at a rate."""
    module = [sys.executable, "-m", "tests.rates.at_rate", str(1.0 / rate)]
    subprocess.run([*module, *words], cwd=REPOSITORY, check=True)


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
