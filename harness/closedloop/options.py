"""The options of a closed loop, each declared once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypedDict

from harness.config.options import Option

DRIVES, RESULT = "The drives", "How it is run"


class DriveOptions(TypedDict, total=False):
    """What a closed loop can be asked for."""

    net: Annotated[str | Path, Option("Network by name, or a folder or .sumocfg file.", panel=DRIVES, default="us101")]
    density: Annotated[float | None, Option("Vehicles per km and main lane, in place of --demand.", panel=DRIVES)]
    demand: Annotated[str | None, Option("Named demand of the network; see 'nets'.", panel=DRIVES)]
    broken_down: Annotated[
        int | None,
        Option("Vehicles that stand broken down in main lanes, as in 'run'. (default: 0)", panel=DRIVES, metavar="N"),
    ]
    beliefs: Annotated[
        str,
        Option(
            "What the ego drives by: truth, detections, driverstate (a human's perception), trackers as in 'stress'. "
            "The truth is added where it is missing.",
            panel=DRIVES,
            default="truth,mmpf,detections",
        ),
    ]
    episodes: Annotated[
        int,
        Option(
            "Episodes by each belief; every second one is provoked.", panel=DRIVES, default=40, least=1, most=10_000
        ),
    ]
    provoke: Annotated[
        str,
        Option(
            "Provocations, in turns: brake (the hidden leader's leader brakes hard), cross (a hidden car has right of "
            "way over the ego), stopped (a vehicle stands in its lane, in plain view), dark (the leader, seldom "
            "detected, brakes hard).",
            panel=DRIVES,
            default="brake",
        ),
    ]
    flow: Annotated[
        float | None,
        Option(
            "Speed at which the traffic flows, on a main road. (default: with stopped one of 10, 15, 20, 25 and 30 by "
            "seed, else the network's)",
            panel=DRIVES,
            metavar="M/S",
            least=5.0,
            most=40.0,
        ),
    ]
    detected: Annotated[
        float | None,
        Option(
            "Share of scans in which the leader of --provoke dark is detected. (default: 0.35)",
            panel=DRIVES,
            metavar="SHARE",
            least=0.01,
            most=1.0,
        ),
    ]
    driver: Annotated[
        str | None, Option("Who drives: hdm, idm, mobil, or module:factory. (default: hdm)", panel=DRIVES)
    ]
    heed_unseen: Annotated[
        float | None,
        Option(
            "Probability of a vehicle that nobody has seen and that it must let pass, from which on the ego creeps up "
            "to a crossing; by trackers. (default: never)",
            panel=DRIVES,
            metavar="PROBABILITY",
            least=0.0,
            most=1.0,
        ),
    ]
    sensor: Annotated[
        str | None, Option("Profile: lidar, radar, camera, ..., or module:profile. (default: lidar)", panel=DRIVES)
    ]
    seed: Annotated[
        int, Option("Seed of the first two episodes; each pair has its own.", panel=DRIVES, default=0, least=0)
    ]
    settings: Annotated[
        list[str] | Mapping[str, object] | None,
        Option("Any setting of config.toml for all drives.", panel=DRIVES, flag="--set", metavar="KEY=VALUE"),
    ]
    out: Annotated[Path, Option("Folder to write.", panel=RESULT, default=Path("results/drive"))]
    resume: Annotated[bool, Option("Keep the drives that --out holds, make the others.", panel=RESULT, default=False)]
    retry_failed: Annotated[bool, Option("Like --resume, and make failed drives again.", panel=RESULT, default=False)]
    workers: Annotated[int | None, Option("Worker processes. (default: one per core)", panel=RESULT, least=1)]
    timeout_per_run: Annotated[
        float | None, Option("Seconds after which a drive is given up.", panel=RESULT, least=0.1)
    ]
