"""The options of ``fidelity`` and ``calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option

FieldsFolder = Annotated[
    Path | None,
    Option("Folder of the recorded fields, to repeat the measurement. (default: the network's measured_file)"),
]
OneWorker = Annotated[int, Option("Number of worker processes.", default=1, least=1)]


class FidelityOptions(TypedDict):
    """The options of ``fidelity``."""

    net: shared.Net
    demand: Annotated[str | None, Option("Names of demands, separated by commas. (default: all with measurements)")]
    seeds: Annotated[str, Option("Number of seeds, or the range A:B without B.", default="0:5")]
    minutes: Annotated[
        float,
        Option(
            "Simulated minutes per run. The first that the recording undercounts (2 on us101) do not count.",
            default=15.0,
            least=1.0,
            most=600.0,
        ),
    ]
    fields: FieldsFolder
    recordings: Annotated[
        list[Path] | None, Option("File or folder of recorded vehicles, as for run --replay; repeatable.")
    ]
    workers: OneWorker
    out: Annotated[Path, Option("Folder to write.", default=Path("results/fidelity"))]
    json: shared.Json
    quiet: shared.Quiet


class CalibrationOptions(TypedDict):
    """The options of ``calibrate``."""

    net: shared.Net
    fields: FieldsFolder
    recordings: Annotated[
        list[Path] | None,
        Option(
            "File or folder of recorded vehicles, to repeat the measurement of lane changes and accelerations; "
            "repeatable. (default: the network's measured_file)"
        ),
    ]
    demand: Annotated[str | None, Option("Fit only this demand and keep the drivers. (default: all measured)")]
    trials: Annotated[int, Option("Number of candidates to simulate.", default=8, least=1, most=1000)]
    seeds: Annotated[
        str,
        Option(
            "Seeds A:B of the first candidate's runs, without B; each further candidate takes the next seeds.",
            default="1000:1001",
        ),
    ]
    minutes: Annotated[
        float,
        Option(
            "Simulated minutes per run, to which the demand schedule is scaled.", default=15.0, least=2.0, most=60.0
        ),
    ]
    step: Annotated[
        float,
        Option("Share of the error that the first step corrects; later ones less.", default=0.9, least=0.1, most=1.0),
    ]
    keep_drivers: Annotated[bool, Option("Fit only the demands, so that trained models stay valid.", default=False)]
    fresh: Annotated[bool, Option("Start from the measurements instead of the existing calibration.", default=False)]
    workers: OneWorker
    write: Annotated[bool, Option("Write the result to the network's folder.", default=False)]
    out: Annotated[Path, Option("Folder to write.", default=Path("results/calibration"))]
    json: shared.Json
    quiet: shared.Quiet
