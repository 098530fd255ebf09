"""``train``: fit and select the behaviour model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.config.options import Option


class Options(TypedDict):
    """The options of ``train``."""

    net: Annotated[
        str | None,
        Option(
            "Network by name, or your own: a folder or .sumocfg file. For turning several, as A,B. (default: us101; "
            "turning: junction,priority,roundabout)"
        ),
    ]
    case: Annotated[str, Option("lane-keeping, lane-change or turning.", default="lane-keeping")]
    components: Annotated[int | None, Option("Components of the mixture. (default: the paper's 28 or 60)", least=1)]
    seeds: Annotated[
        str | None,
        Option(
            "Seeds A:B of the training traffic, B excluded. (default: 1000:1032; lane-change, which is rarer, "
            "1000:1040; turning, of each network, 1000:1006)"
        ),
    ]
    seed: Annotated[int, Option("Seed of sampling and of the fit of a mixture.", default=0, least=0)]
    sweep: Annotated[
        bool,
        Option(
            "Score other numbers of a mixture's components by BIC, for the card.",
            default=True,
            flag="--sweep/--no-sweep",
        ),
    ]
    cache: Annotated[Path | None, Option("Folder of recorded traffic. (default: results/cache/traffic/NET-...)")]
    out: Annotated[Path, Option("Folder of the model files and cards.", default=Path("results/models"))]
    json: Annotated[bool, Option("Print the files as JSON on stdout.", default=False)]


def command(options: Options) -> None:
    """Record SUMO traffic, fit the Gaussian mixtures, and write model files with their cards.

    Recordings are kept: an interrupted training goes on where it stopped.

    Examples:
      python -m harness train --net us101 --case lane-keeping
      python -m harness train --case lane-change --components 40 --no-sweep
      python -m harness train --case turning
    """
    from harness.common.errors import InputError  # noqa: PLC0415
    from harness.config.lists import seed_values  # noqa: PLC0415
    from harness.lab.fit.train import TrainingPlan, train  # noqa: PLC0415
    from harness.lab.fit.turning_fit import ON_NETWORKS, TURNING, train_turning  # noqa: PLC0415
    from harness.lab.windows.scenarios import FIRST_TRAINING_SEED  # noqa: PLC0415
    from harness.truth.network.network import load_network  # noqa: PLC0415

    case = options["case"]
    seeds = options["seeds"] or {"lane-change": "1000:1040", TURNING: "1000:1006"}.get(case, "1000:1032")
    traffic = seed_values(seeds)
    first, count = traffic.start, len(traffic)
    if first < FIRST_TRAINING_SEED:
        raise InputError(
            f"`seeds` {seeds}: seeds below {FIRST_TRAINING_SEED} are kept for tuning and reporting; "
            f"give {FIRST_TRAINING_SEED} and up"
        )

    def say(line: str) -> None:
        typer.echo(line, err=True)

    if case == TURNING:
        if options["components"] is not None:
            raise InputError("`components`: the case turning fits six numbers and no mixture; leave it out")
        networks = [load_network(name) for name in (options["net"] or ON_NETWORKS).split(",")]
        paths = [train_turning(networks, traffic, options["cache"], options["out"], say)]
    else:
        plan = TrainingPlan(
            *(case, options["components"], first, count, options["seed"], options["sweep"]),
            *(options["cache"], options["out"]),
        )
        paths = train(plan, load_network(options["net"] or "us101"), say)
    if options["json"]:
        typer.echo(json.dumps({"models": [str(path) for path in paths]}))
    else:
        for path in paths:
            typer.echo(f"{path} and {path.with_suffix('.md').name}")
