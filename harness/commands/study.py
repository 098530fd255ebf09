"""``study``: the paper's lane-keeping and lane-change cases on held-out traffic, and errors by situation."""

from pathlib import Path
from typing import Annotated, TypedDict

from harness.common.errors import InputError
from harness.config import options as shared
from harness.config.options import Option, options_of

NO_CHOICE = {
    "ablation": (("models", "model_file", "real_data", "cases", "particles", "seed", "cache"), "the ablation study"),
    "recordings": (("net", "seeds", "cache"), "a study of recordings"),
    "situations": ((), "the study by situation"),
}
"""By study, the options that it has no use for, and how its message names it."""


class Options(TypedDict):
    """The options of ``study``."""

    case: Annotated[
        str, Option("lane-keeping, lane-change, situations or ablation.", default=..., metavar="CASE", is_argument=True)
    ]
    net: shared.Net
    models: Annotated[str | None, Option("Names of models, separated by commas. (default: all that fit the case)")]
    model_file: Annotated[
        Path | None, Option("Your own fitted model file; replaces the bundled gmm, or the one model in --models.")
    ]
    cases: Annotated[int, Option("Held-out cases.", default=240, least=2, most=100_000)]
    particles: Annotated[int, Option("Particles per case.", default=1000, least=2, most=1_000_000)]
    seed: shared.Seed
    seeds: Annotated[
        str | None,
        Option(
            "Traffic seeds A:B without B; each seed is run at every density. No model was trained on seeds below 100. "
            "(default: 0:2; ablation: 0:4)"
        ),
    ]
    cache: shared.Cache
    real_data: Annotated[Path | None, Option("Folder of real recordings, for situations. (default: simulated)")]
    out: Annotated[Path | None, Option("Folder to write. (default: results/study-CASE)")]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Predict through occlusion with every motion model: the paper's two cases, and errors by situation.

    situations: errors after 1 to 10 s unseen in free driving, following,
    stop-and-go, after a cut-in and around lane changes, simulated or, with
    --real-data, recorded. With --model-file it shows how a model that was
    trained on one road does on another. --net must have one main road.
    ablation: in dense traffic, undo the tracker's departures from the paper
    one at a time.

    Writes results.json, results.md (tables with 95 % intervals), figures,
    and one page with all of them, report.html.

    Examples:
      python -m harness study lane-keeping
      python -m harness study lane-change --models gmm,cvm,cam --cases 100
      python -m harness study situations --real-data recordings
      python -m harness study situations --models residual --model-file my.npz
      python -m harness study ablation
    """
    case: str = options["case"]
    if case == "situations" and options["real_data"] is not None:
        case = "recordings"
    parameters, study = NO_CHOICE.get(case, (("real_data",), "a study of simulated traffic"))
    for parameter in parameters:
        if options.get(parameter) != options_of(Options)[parameter].option.default:
            raise InputError(f"`{parameter}`: {study} has no such choice; leave it out")
    from harness.commands.actions.make_study import make_study_of  # noqa: PLC0415

    make_study_of(options)
