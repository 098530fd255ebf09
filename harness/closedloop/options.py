"""The options of a closed loop."""

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import EXECUTION, Option

DRIVES = "The drives"


class DriveOptions(TypedDict, total=False):
    """The options of a closed loop."""

    net: shared.Net
    density: shared.Density
    demand: shared.Demand
    broken_down: shared.BrokenDown
    perception: Annotated[
        str,
        Option(
            "What the ego's driver sees: truth, detections, or trackers as in 'stress'. Truth is always included.",
            panel=DRIVES,
            default="truth,mmpf,detections",
        ),
    ]
    episodes: Annotated[
        int,
        Option(
            "Episodes per perception; every second one has a provocation.",
            panel=DRIVES,
            default=40,
            least=1,
            most=10_000,
        ),
    ]
    provoke: Annotated[
        str,
        Option(
            "Provocations, used in turn: brake (the hidden leader's leader brakes hard), cross (a hidden car has right "
            "of way over the ego), stopped (a vehicle in plain view stands in the ego's lane), dark (the leader, "
            "rarely detected, brakes hard).",
            panel=DRIVES,
            default="brake",
        ),
    ]
    flow: Annotated[
        float | None,
        Option(
            "Speed of the traffic on a main road. (default: with stopped, one of 10, 15, 20, 25 and 30 chosen by seed; "
            "otherwise the network's)",
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
        str | None, Option("Driver model of the ego: hdm, idm, mobil, or module:factory. (default: hdm)", panel=DRIVES)
    ]
    heed_unseen: Annotated[
        float | None,
        Option(
            "Approach a crossing at creeping speed if the tracker's probability of an undetected vehicle with right of "
            "way exceeds this. (default: never)",
            panel=DRIVES,
            metavar="PROBABILITY",
            least=0.0,
            most=1.0,
        ),
    ]
    sensor: shared.Sensor
    seed: Annotated[
        int,
        Option(
            "Seed of the first two episodes; each further pair takes the next seed.", panel=DRIVES, default=0, least=0
        ),
    ]
    settings: shared.Settings
    out: Annotated[Path, Option("Folder to write.", panel=EXECUTION, default=Path("results/drive"))]
    resume: shared.Resume
    retry_failed: shared.RetryFailed
    workers: shared.Workers
    timeout_per_run: shared.TimeoutPerRun
