"""The commands that are compared: short ones that together reach every network, recording, figure and format."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A command of the harness, run in the folder where the others' results are.

    Attributes:
        group: What ``--only`` takes to choose it with its like.
        words: What is typed. A word that names another command is that one's folder.
        needs: Commands that are run before, beside those that words name.
        folder: What is compared beside what is printed, if it is not the folder of the command's own name.
    """

    group: str
    words: tuple[str, ...]
    needs: tuple[str, ...] = ()
    folder: str | None = None


def _writing(group: str, name: str, typed: str, needs: tuple[str, ...] = ()) -> dict[str, Command]:
    """Return a command that writes a folder of its own name."""
    return {name: Command(group, (*typed.split(), "--out", name), needs)}


RUNS = {
    "lidar": "--duration 6 --seed 1",
    "radar": "--duration 6 --seed 2 --sensor radar --model idm",
    "camera": "--duration 6 --seed 3 --sensor camera --model cvm --density 45",
    "paper": "--duration 6 --seed 4 --update max_likelihood --model cam",
    "short": "--duration 6 --seed 5 --model gmm-short --particles 300 --density 20",
    "jpda": "--duration 6 --seed 6 --tracker stonesoup-jpda",
    "oracle": "--duration 6 --seed 7 --tracker oracle-kalman --demand us101-0820",
    "replay": "--duration 6 --replay lidar --model gmm-lane-change --seed 8",
    "lidar-real": "--duration 3 --seed 9 --sensor lidar-real --density 20",
    "pmbm": "--duration 3 --seed 10 --tracker pmbm --density 20 --broken-down 2",
}
NETWORKS = {
    "junction": "--net junction --duration 3 --seed 1",
    "roundabout": "--net roundabout --duration 3 --seed 1",
    "priority": "--net priority --duration 3 --seed 1 --sensor radar",
    "curve": "--net curve --duration 2 --seed 1 --demand light",
    "no-map": "--net junction --duration 2 --seed 2 --set tracker.believes.map=none",
}
RECORDINGS = {
    "ngsim": "--replay recordings/ngsim.csv --ego 12",
    "ngsim-text": "--replay recordings/ngsim.txt --tracker oracle-kalman",
    "commonroad": "--replay recordings/straight.xml",
    "commonroad-crossing": "--replay recordings/crossing.xml --ego 2",
    "highd": "--replay recordings/highd --ego auto",
    "fcd": "--replay recordings/traffic.xml --net us101",
    "kitti": "--replay recordings/kitti --format kitti-tracking",
}
DRIVES = {
    "drive-brake": "--provoke brake --density 20",
    "drive-cross": "--provoke cross --net priority --heed-unseen 0.1",
    "drive-stopped": "--provoke stopped --density 15 --flow 15",
    "drive-dark": "--provoke dark --density 20",
}
FORMATS = ("csv", "fcd", "mot", "mcap", "autoware", "osi", "rerun")
HELPED = (
    *("run", "nets", "settings", "report", "export", "compare", "stress", "drive", "study", "bench"),
    *("train", "fidelity", "calibrate"),
)
REFUSED = {
    "refused-net": "run --net nowhere",
    "refused-model": "run --model nothing --out refused",
    "refused-setting": "run --set sensor.range=1",
    "refused-format": "export lidar --to nothing",
    "refused-folder": "compare recordings recordings",
}

COMMANDS: dict[str, Command] = {
    "help": Command("help", ("--help",)),
    **{f"help-{name}": Command("help", (name, "--help")) for name in HELPED},
    "nets": Command("help", ("nets",)),
    "settings": Command("help", ("settings",)),
}
for _name, _typed in RUNS.items():
    COMMANDS |= _writing("runs", _name, f"run {_typed} --quiet")
for _name, _typed in NETWORKS.items():
    COMMANDS |= _writing("networks", _name, f"run {_typed} --quiet")
for _name, _typed in RECORDINGS.items():
    COMMANDS |= _writing("recordings", _name, f"run {_typed} --quiet")
for _name in FORMATS:
    COMMANDS |= _writing("exports", f"export-{_name}", f"export lidar --to {_name}")
COMMANDS |= {
    **_writing("exports", "export-junction-fcd", "export junction --to fcd --gzip"),
    **_writing("exports", "export-junction-csv", "export junction --to csv --gzip"),
    **_writing("exports", "export-kitti", "export kitti --to kitti"),
    "figures": Command("figures", ("report", "radar", "--figures", "svg"), folder="radar/figures"),
    "page": Command("figures", ("report", "camera"), folder="camera"),
    "compare": Command(
        "compare",
        ("compare", "lidar", "replay", "--markdown", "compare/table.md", "--html", "compare/page.html"),
    ),
    "compare-json": Command("compare", ("compare", "lidar", "replay", "--json", "--quiet")),
    "compare-labels": Command("compare", ("compare", "stress@mmpf", "stress@stonesoup-gnn"), ("stress",)),
    "compare-drives": Command("compare", ("compare", "drive-brake@truth", "drive-brake@detections"), ("drive-brake",)),
    **_writing(
        "stress",
        "stress",
        "stress --densities 15,45 --seeds 1 --duration 4 --quiet --workers 1 "
        "--trackers mmpf,mmpf+update=max_likelihood,stonesoup-gnn",
    ),
    **_writing("stress", "stress-nets", "stress --nets curve,junction --seeds 1 --duration 2 --quiet --workers 1"),
    **_writing(
        "stress",
        "stress-mismatch",
        "stress --densities 20 --seeds 2 --duration 2 --mismatch --trackers mmpf,stonesoup-gnn --quiet --workers 1",
    ),
    **_writing(
        "stress",
        "stress-altered",
        "stress --replay lidar --mismatch dark,posts,ego-jitter,5-hz,one-lane --quiet --workers 1",
    ),
    **_writing(
        "stress",
        "stress-recorded",
        "stress --replay recordings/straight.xml --replay recordings/crossing.xml --ego each:2 --trackers "
        "mmpf,oracle-kalman --quiet --workers 1",
    ),
    **_writing(
        "stress",
        "stress-kitti",
        "stress --replay recordings/kitti/label_02 --format kitti-tracking --quiet --workers 1",
    ),
    **_writing("study", "study", "study lane-keeping --cases 6 --particles 50 --seeds 0:1 --cache traffic --quiet"),
    **_writing(
        "study", "study-lane-change", "study lane-change --cases 6 --particles 50 --seeds 0:1 --cache traffic --quiet"
    ),
    **_writing("slow", "ablation", "study ablation --seeds 0:1 --quiet"),
    **_writing("slow", "fidelity", "fidelity --seeds 0:1 --minutes 1 --demand us101-0805 --quiet"),
    **{name: Command("refused", tuple(typed.split())) for name, typed in REFUSED.items()},
}
for _name, _typed in DRIVES.items():
    COMMANDS |= _writing(
        "drives",
        _name,
        f"drive --episodes 2 --seed 100 --perception truth,mmpf,detections {_typed} --quiet --workers 1",
    )
# In this order each stands behind what it needs.
COMMANDS = {
    **{name: one for name, one in COMMANDS.items() if one.group != "compare"},
    **{name: one for name, one in COMMANDS.items() if one.group == "compare"},
}
SLOW = tuple(name for name, command in COMMANDS.items() if command.group == "slow")


def needed(chosen: Iterable[str]) -> list[str]:
    """Return the commands of groups or names, with those that they need, in the order in which they are run.

    Raises:
        SystemExit: A word is neither a group nor a command.
    """
    wanted: set[str] = set()
    for word in chosen:
        named = {name for name, command in COMMANDS.items() if word in (name, command.group)}
        if not named:
            raise SystemExit(f"--only: there is no group or command {word!r}")
        wanted |= named
    waiting = list(wanted)
    while waiting:
        name = waiting.pop()
        command = COMMANDS[name]
        before = ({*command.words[1:], *command.needs} & COMMANDS.keys()) - {name, *wanted}
        wanted |= before
        waiting += before
    return [name for name in COMMANDS if name in wanted]
