"""The options of ``score``, apart from what it does, so that its help takes no time to import."""

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config.lists import MOST_SEED
from harness.config.options import Option


class Logs(TypedDict):
    """What is scored, as the options of ``score`` say it."""

    truth: Annotated[Path, Option("Truth: a run's folder, or a file or folder of a format.", default=...)]
    tracks: Annotated[Path, Option("Tracks that a tracker reported.", default=...)]
    detections: Annotated[
        Path | None, Option("Detections that the tracker got. (default: the true positions in view)", metavar="PATH")
    ]
    ego: Annotated[
        str | None,
        Option("Vehicle that carries the sensor, or a file of its poses. (default: the column is_ego)", metavar="NAME"),
    ]
    format: Annotated[
        str | None, Option("parquet, csv, kitti, mot, nuscenes or mcap. (default: by the content)", metavar="FORMAT")
    ]
    step: Annotated[
        float | None,
        Option("Seconds between frames with only a number. (default: 0.1)", metavar="SECONDS", least=0.001),
    ]
    sensor: Annotated[str | None, Option("Sensor profile whose range and field of view are used. (default: lidar)")]
    settings: Annotated[
        list[str] | None, Option("A setting of the sensor; repeatable.", flag="--set", metavar="sensor.KEY=VALUE")
    ]
    seed: Annotated[
        int | None,
        Option("Seed of the bootstrap intervals; with a run's truth, the run's. (default: 0)", least=0, most=MOST_SEED),
    ]
    name: Annotated[str | None, Option("What the tracker is called. (default: the file's name)")]
