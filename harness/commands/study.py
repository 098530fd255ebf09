"""``study``: the published lane-keeping and lane-change cases on held-out traffic, and transfer to real roads."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import typer

from harness.common.errors import InputError
from harness.config.options import Option

ABLATION_S = 30.0

if TYPE_CHECKING:
    from harness.lab.study.published import StudyPlan
    from harness.lab.study.transfer.transfer import TransferPlan
    from harness.truth.network.network import Network


class Options(TypedDict):
    """The options of ``study``."""

    case: Annotated[str, Option("lane-keeping, lane-change, transfer or ablation.", default=..., is_argument=True)]
    net: Annotated[str, Option("Network by name, or your own: a folder or .sumocfg file.", default="us101")]
    models: Annotated[str | None, Option("Models by name, with commas between. (default: all that suit the case)")]
    model_file: Annotated[Path | None, Option("A fitted model of your own in place of the gmm that comes along.")]
    cases: Annotated[int, Option("Held-out cases.", default=240, least=2)]
    particles: Annotated[int | None, Option("Particles per case. (default: 1000; transfer: 200)", least=2)]
    seed: Annotated[int, Option("Root of all randomness.", default=0, least=0)]
    seeds: Annotated[
        str | None,
        Option("Seeds A:B of the traffic, B excluded; below 100 none was trained on. (default: 0:16; ablation: 0:4)"),
    ]
    cache: Annotated[Path | None, Option("Folder of recorded traffic. (default: results/cache/traffic/NET-...)")]
    real_data: Annotated[
        Path | None,
        Option("transfer: folder of real recordings. (default: $MMPF_REALDATA)"),
    ]
    out: Annotated[Path | None, Option("Folder to write. (default: results/study-CASE)")]
    json: Annotated[bool, Option("Print results.json on stdout, nothing else there.", default=False)]
    quiet: Annotated[bool, Option("No progress bar.", default=False)]


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
    from harness.config.lists import seed_values  # noqa: PLC0415
    from harness.truth.network.network import load_network  # noqa: PLC0415

    case, net, quiet = options["case"], options["net"], options["quiet"]
    traffic = seed_values(options["seeds"] or ("0:4" if case == "ablation" else "0:16"))
    first, count = traffic.start, len(traffic)
    folder = options["out"] or Path("results") / f"study-{case}"

    def say(line: str) -> None:
        if not quiet:
            typer.echo(line, err=True)

    if case == "ablation":
        _refuse(options, ("models", "model_file", "real_data"), "the ablation study")
        told = _make_ablation(net, f"{first}:{first + count}", folder, quiet)
    elif case == "transfer":
        from harness.lab.study.transfer.transfer import TransferPlan  # noqa: PLC0415
        from harness.lab.windows.realdata import real_data_folder  # noqa: PLC0415

        _refuse(options, ("models", "model_file"), "the transfer study")
        transfer = TransferPlan(
            real_data_folder(options["real_data"]),
            options["cases"],
            options["particles"] or 200,
            options["seed"],
            first,
            count,
            cache=options["cache"],
        )
        told = _make_transfer(transfer, load_network(net), folder, say, quiet)
    else:
        from harness.lab.study.published import StudyPlan  # noqa: PLC0415

        _refuse(options, ("real_data",), "a study of simulated traffic")
        chosen = tuple(name.strip() for name in (options["models"] or "").split(",") if name.strip())
        published = StudyPlan(
            case,
            chosen,
            options["model_file"],
            options["cases"],
            options["particles"] or 1000,
            options["seed"],
            first,
            count,
            options["cache"],
        )
        told = _make_published(published, load_network(net), folder, say, quiet)
    from harness.report.folderpage import write_page  # noqa: PLC0415

    write_page(folder)
    if options["json"]:
        typer.echo(json.dumps(told.numbers))
    else:
        from harness.common.markdown import show_markdown  # noqa: PLC0415

        show_markdown(told.text)
    typer.echo(f"written to {folder}", err=True)


@dataclass(frozen=True)
class _Told:
    """What a study says on stdout, for programs and for people."""

    numbers: dict[str, Any]
    text: str


def _refuse(options: Options, parameters: tuple[str, ...], study: str) -> None:
    for parameter in parameters:
        if options.get(parameter) is not None:
            raise InputError(f"`{parameter}`: {study} has no such choice; leave it out")


def _make_ablation(net: str, seeds: str, folder: Path, quiet: bool) -> _Told:
    import pandas as pd  # noqa: PLC0415

    from harness.grid.grid import GridRequest  # noqa: PLC0415
    from harness.grid.making import Telling  # noqa: PLC0415
    from harness.grid.pool import run_cells  # noqa: PLC0415
    from harness.grid.stress import run_stress  # noqa: PLC0415
    from harness.lab.ablation import (  # noqa: PLC0415
        IDEAL_ABLATIONS,
        ablation_request,
        ablation_rows,
        as_markdown,
        ideal_request,
        write_ablation,
    )
    from harness.storage.grid_folder import RUNS  # noqa: PLC0415

    def runs_of(request: GridRequest, out: Path) -> pd.DataFrame:
        run_stress(
            request,
            out,
            lambda cells, on_row: run_cells(cells, os.cpu_count() or 1, None, on_row),
            resume=(out / RUNS).exists() or (out / "grid.json").exists(),
            user=Telling(quiet),
            command="harness study ablation",
        )
        return pd.read_parquet(out / RUNS)

    rows = ablation_rows(runs_of(ablation_request(net, seeds, ABLATION_S), folder))
    ideal = ablation_rows(runs_of(ideal_request(net, seeds, ABLATION_S), folder / "ideal"), IDEAL_ABLATIONS)
    setting = (
        f"SUMO {net} at 45 vehicles per km and lane, seeds {seeds}, {ABLATION_S:g} s each, 1000 particles, gmm unless "
        "an arm says otherwise."
    )
    return _Told(write_ablation(rows, ideal, setting, folder), as_markdown(rows, ideal, setting))


def _make_transfer(
    plan: TransferPlan, network: Network, folder: Path, say: Callable[[str], None], quiet: bool
) -> _Told:
    from harness.common.progress import progress_bar  # noqa: PLC0415
    from harness.lab.study.transfer.transfer import MODELS, TEST_SETS, make_transfer_study  # noqa: PLC0415
    from harness.lab.study.transfer.written import as_json, as_markdown, write_transfer  # noqa: PLC0415

    before = "study transfer: recording, reading and fitting"
    with progress_bar("study transfer: predicting", MODELS * TEST_SETS, quiet, before) as advance:
        result = make_transfer_study(plan, network, say, advance)
    write_transfer(result, folder)
    return _Told(as_json(result), as_markdown(result))


def _make_published(plan: StudyPlan, network: Network, folder: Path, say: Callable[[str], None], quiet: bool) -> _Told:
    from harness.common.progress import progress_bar  # noqa: PLC0415
    from harness.lab.study.published import MODELS, make_study  # noqa: PLC0415
    from harness.lab.study.written import as_json, as_markdown, write_study  # noqa: PLC0415

    runs = plan.runs if plan.study in MODELS else 1
    title = f"study {plan.study}"
    try:
        with progress_bar(f"{title}: predicting", runs, quiet, before=f"{title}: recording and compiling") as advance:
            result, setting = make_study(plan, network, say, advance)
    except ValueError as error:
        raise InputError(f"`model_file` {plan.model_file}: {error}") from error
    write_study(result, setting, folder)
    return _Told(as_json(result, setting), as_markdown(result, setting))
