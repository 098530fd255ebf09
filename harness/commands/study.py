"""``study``: the published lane-keeping and lane-change cases on held-out traffic, and transfer to real roads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.common.errors import InputError
from harness.config import options as shared
from harness.config.options import Option

NO_CHOICE = {
    "ablation": (("models", "model_file", "real_data"), "the ablation study"),
    "transfer": (("models", "model_file"), "the transfer study"),
}
"""By study, the options that it has no use for, and how its message names it."""


class Options(TypedDict):
    """The options of ``study``."""

    case: Annotated[str, Option("lane-keeping, lane-change, transfer or ablation.", default=..., is_argument=True)]
    net: shared.Net
    models: Annotated[str | None, Option("Models by name, with commas between. (default: all that suit the case)")]
    model_file: Annotated[Path | None, Option("A fitted model of your own in place of the gmm that comes along.")]
    cases: Annotated[int, Option("Held-out cases.", default=240, least=2)]
    particles: Annotated[int | None, Option("Particles per case. (default: 1000; transfer: 200)", least=2)]
    seed: shared.Seed
    seeds: Annotated[
        str | None,
        Option(
            "Seeds A:B of the traffic, B excluded; each drives every density; below 100 none was trained on. "
            "(default: 0:2; ablation: 0:4)"
        ),
    ]
    cache: shared.Cache
    real_data: Annotated[
        Path | None,
        Option("transfer: folder of real recordings. (default: $MMPF_REALDATA)"),
    ]
    out: Annotated[Path | None, Option("Folder to write. (default: results/study-CASE)")]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Predict through occlusion with every motion model: the paper's two cases, and transfer to real roads.

    transfer: models trained on SUMO, on real pairs and on both, tested on
    real pairs and recordings that no model has seen, and on SUMO.
    ablation: the tracker with one of its departures from the paper taken
    back at a time, in dense traffic.

    Writes results.json, results.md (tables with 95 % intervals), figures,
    and all of it as one page, report.html.

    Examples:
      python -m harness study lane-keeping
      python -m harness study lane-change --models gmm,cvm,cam --cases 100
      python -m harness study transfer --real-data recordings
      python -m harness study ablation
    """
    parameters, study = NO_CHOICE.get(options["case"], (("real_data",), "a study of simulated traffic"))
    for parameter in parameters:
        if options.get(parameter) is not None:
            raise InputError(f"`{parameter}`: {study} has no such choice; leave it out")
    from harness.commands.actions.make_study import make_study_of  # noqa: PLC0415

    make_study_of(options)
