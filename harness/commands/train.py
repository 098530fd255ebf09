"""``train``: fit motion models to simulated traffic."""

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``train``."""

    net: Annotated[
        str | None,
        Option(
            "Network by name, or your own: a folder or .sumocfg file. --case turning takes several: A,B. (default: "
            "us101; turning: junction, priority and roundabout)"
        ),
    ]
    case: Annotated[
        str,
        Option(
            "lane-keeping, lane-change, residual, recurrent (needs the extra deep), empirical or turning.",
            default="lane-keeping",
        ),
    ]
    components: Annotated[
        int | None, Option("Components of the mixture. (default: the paper's 28 or 60)", least=1, most=10_000)
    ]
    seeds: Annotated[
        str | None,
        Option(
            "Seeds A:B of the training traffic, without B; each seed is run at every density. (default: 1000:1002; "
            "lane-change: 1000:1003)"
        ),
    ]
    densities: Annotated[
        str | None,
        Option(
            "Densities of that traffic, vehicles per km and lane: 20,40 or 8:57:7. (default: 8 to 57 in steps of 7)"
        ),
    ]
    duration: Annotated[
        float | None,
        Option(
            "Seconds of traffic for each seed and density. (default: 200)", metavar="SECONDS", least=10, most=86_400
        ),
    ]
    seed: shared.Seed
    cache: shared.Cache
    out: Annotated[Path, Option("Folder for the model files and cards.", default=Path("results/models"))]
    json: shared.Json


def command(options: Options) -> None:
    """Record SUMO traffic, fit motion models to it, and write model files with their cards.

    Recordings are kept, so an interrupted training can continue. A model
    file carries a digest: one that was altered since is refused.

    Examples:
      python -m harness train --net us101 --case lane-keeping
      python -m harness train --case lane-change --components 40
      python -m harness train --case turning
    """
    from harness.commands.actions.fit_model import fit_model  # noqa: PLC0415

    fit_model(options)
