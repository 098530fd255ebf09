"""Makes a study, writes its folder and page, and prints the result."""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import typer

from harness.common.files import check_folder, write_results
from harness.common.markdown import show_markdown
from harness.common.progress import progress_bar
from harness.config.lists import names, seed_values
from harness.grid.grid import GridRequest
from harness.grid.making import on_stderr
from harness.grid.pool import run_cells
from harness.grid.stress import run_stress
from harness.lab.ablation import IDEAL_ABLATIONS, IDEAL_SENSOR, ablation_request, ablation_rows, as_markdown
from harness.lab.study import situations, study, study_text
from harness.lab.study.figures import draw_study
from harness.lab.windows.car_following import STEPS
from harness.report.folder_page import write_page
from harness.storage.grid_folder import RUNS
from harness.truth.network.network import Network, load_network

ABLATION_S = 30.0
Results = tuple[dict[str, Any], str]
"""A study's results, for programs and for people."""


def make_study_of(options: Mapping[str, Any]) -> None:
    """Make the study that the options of ``study`` describe."""
    case, net, quiet = options["case"], options["net"] or "us101", options["quiet"]
    traffic = seed_values(options["seeds"] or ("0:4" if case == "ablation" else "0:2"))
    folder = options["out"] or Path("results") / f"study-{case}"

    def say(line: str) -> None:
        if not quiet:
            typer.echo(line, err=True)

    check_folder(folder, "out")
    if case == "ablation":
        numbers, text = _make_ablation(net, f"{traffic.start}:{traffic.stop}", folder, quiet)
    else:
        chosen = () if options["models"] is None else names(options["models"], "models", "gmm,cvm")
        cases = study.StudyPlan(
            *(case, chosen, options["model_file"], options["cases"], options["particles"], options["seed"]),
            *(traffic, options["cache"]),
        )
        network = load_network(net)
        if case == situations.SITUATIONS:
            numbers, text = _make_situations(cases, network, options["real_data"], say, quiet)
        else:
            runs, title = cases.runs if case in study.MODELS else 1, f"study {case}"
            before = f"{title}: recording and compiling"
            with progress_bar(f"{title}: predicting", runs, quiet, before=before) as advance:
                result, setting = study.make_study(cases, network, say, advance)
            draw_study(result, folder)
            numbers = study_text.as_json(result.rows, setting)
            text = study_text.as_markdown(result, setting)
    write_results(folder, numbers, text)
    write_page(folder)
    if options["json"]:
        typer.echo(json.dumps(numbers))
    else:
        show_markdown(text)
    typer.echo(f"written to {folder}", err=True)


def _make_ablation(net: str, seeds: str, folder: Path, quiet: bool) -> Results:
    def runs_of(request: GridRequest, out: Path) -> pd.DataFrame:
        run_stress(
            request,
            out,
            lambda cells, on_row: run_cells(cells, os.cpu_count() or 1, None, on_row),
            resume=(out / RUNS).exists() or (out / "grid.json").exists(),
            user=on_stderr(quiet),
            command="harness study ablation",
        )
        return pd.read_parquet(out / RUNS)

    rows = ablation_rows(runs_of(ablation_request(net, seeds, ABLATION_S), folder))
    request = ablation_request(net, seeds, ABLATION_S, IDEAL_ABLATIONS, IDEAL_SENSOR)
    ideal = ablation_rows(runs_of(request, folder / "ideal"), IDEAL_ABLATIONS)
    setting = (
        f"SUMO {net} at 45 vehicles per km and lane, seeds {seeds}, {ABLATION_S:g} s each, 1000 particles, the default "
        "model unless an arm says otherwise."
    )
    numbers = {"study": "ablation", "setting": setting, "results": rows, "ideal": ideal}
    return numbers, as_markdown(rows, ideal, setting)


def _make_situations(
    plan: study.StudyPlan, net: Network, real: Path | None, say: Callable[[str], None], quiet: bool
) -> Results:
    if real is not None:
        parts, steps = situations.recorded_parts(real), situations.SHORT_STEPS
    else:
        _ = net.main_road  # which the cases are recorded along
        parts, steps = situations.simulated_parts(plan, net, say), STEPS
    runs = 5 * len(plan.models or situations.MODELS)
    with progress_bar("study situations: predicting", runs, quiet, before="study situations: compiling") as advance:
        rows = situations.situation_rows(plan, parts, steps, advance)
    setting = plan.setting(net, plan.cases)
    del setting["measurement_noise_under_partial_occlusion"]
    if real is not None:
        for name in ("network", "densities_veh_per_km_lane", "traffic_seeds"):
            del setting[name]
        setting["recordings"] = len(parts)
    return study_text.as_json(rows, setting), situations.as_markdown(rows, setting)
