"""``train``: fit and select the behaviour model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    net: Annotated[str, typer.Option(help="Network by name, or your own: a folder or .sumocfg file.")] = "us101",
    case: Annotated[str, typer.Option(help="lane-keeping or lane-change.")] = "lane-keeping",
    components: Annotated[
        int | None, typer.Option(help="Components of the mixture. (default: the paper's 28 or 60)", min=1)
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            help="Seeds A:B of the training traffic, B excluded. (default: 1000:1032; lane-change, which is rarer, "
            "1000:1040)"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of sampling and of the fit.", min=0)] = 0,
    sweep: Annotated[bool, typer.Option(help="Score other numbers of components by BIC, for the card.")] = True,
    cache: Annotated[
        Path | None, typer.Option(help="Folder of recorded traffic. (default: results/cache/traffic/NET-...)")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the model files and cards.")] = Path("results/models"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the files as JSON on stdout.")] = False,
) -> None:
    """Record SUMO traffic, fit the Gaussian mixtures, and write model files with their cards.

    Recordings are kept: an interrupted training goes on where it stopped.

    Examples:
      python -m harness train --net us101 --case lane-keeping
      python -m harness train --case lane-change --components 40 --no-sweep
    """
    from harness.config.lists import seed_values  # noqa: PLC0415
    from harness.driving.scenarios import FIRST_TRAINING_SEED  # noqa: PLC0415
    from harness.errors import UserError  # noqa: PLC0415
    from harness.training.train import TrainingPlan, train  # noqa: PLC0415
    from harness.truth.network.network import load_network  # noqa: PLC0415

    seeds = seeds or ("1000:1040" if case == "lane-change" else "1000:1032")
    traffic = seed_values(seeds)
    first, count = traffic.start, len(traffic)
    if first < FIRST_TRAINING_SEED:
        raise UserError(
            f"--seeds {seeds}: seeds below {FIRST_TRAINING_SEED} are kept for tuning and reporting; "
            f"give {FIRST_TRAINING_SEED} and up"
        )
    plan = TrainingPlan(case, components, first, count, seed, sweep, cache, out)
    paths = train(plan, load_network(net), lambda line: typer.echo(line, err=True))
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps({"models": [str(path) for path in paths]}))
    else:
        for path in paths:
            typer.echo(f"{path} and {path.with_suffix('.md').name}")
