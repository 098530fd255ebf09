"""The options of a closed loop, each declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import EXECUTION, Option

DRIVES = "The drives"


class DriveOptions(TypedDict, total=False):
    """What a closed loop can be asked for."""

    net: shared.Net
    density: shared.Density
    demand: shared.Demand
    broken_down: shared.BrokenDown
    perception: Annotated[
        str,
        Option(
            "What the ego drives by: truth, detections, driverstate (a human's perception), trackers as in 'stress'. "
            "The truth is added where it is missing.",
            panel=DRIVES,
            default="truth,mmpf,detections",
            earlier="--beliefs",
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
    sensor: shared.Sensor
    seed: Annotated[
        int, Option("Seed of the first two episodes; each pair has its own.", panel=DRIVES, default=0, least=0)
    ]
    settings: shared.Settings
    out: Annotated[Path, Option("Folder to write.", panel=EXECUTION, default=Path("results/drive"))]
    resume: shared.Resume
    retry_failed: shared.RetryFailed
    workers: shared.Workers
    timeout_per_run: shared.TimeoutPerRun
