import html
import json
import re
import shlex
from dataclasses import asdict

import pandas as pd
import pytest

from harness.commands.app import run_command_line
from harness.config.options import keys_of_options
from harness.grid.cells import command_of
from harness.grid.grid import GridRequest, plan_grid
from harness.report.comparison_page import write_kept_pages
from harness.report.folder_page import write_page
from harness.report.grid_runs import BESIDE
from harness.running.resolve import resolve_run_config
from harness.storage.manifest import RunFacts, write_manifest
from tests.harness.recorded_scene import write_recorded_scene


def told(command):
    """Return the configuration that a command line asks for, read as ``run`` reads it."""
    words = shlex.split(command)
    assert words[:4] == ["python", "-m", "harness", "run"]
    flags, values = words[4::2], words[5::2]
    settings = [value for flag, value in zip(flags, values, strict=True) if flag == "--set"]
    named = {flag[2:].replace("-", "_"): value for flag, value in zip(flags, values, strict=True) if flag != "--set"}
    assert set(named) <= set(keys_of_options())
    numbers = {name: json.loads(value) for name, value in named.items() if re.fullmatch(r"[\d.]+", value)}
    return resolve_run_config(None, named | numbers, settings)


@pytest.mark.parametrize(
    "request_",
    [
        GridRequest(densities="30,45", models="gmm,idm", seeds="3:5"),
        GridRequest(demands="us101-0750", trackers="mmpf+update=max_likelihood,stonesoup-jpda", seeds="1"),
        GridRequest(densities="20", vary=("sensor.range_m=40,160", "tracker.particles=200,500"), duration_s=9.5),
        GridRequest(densities="20", trackers="mmpf,stonesoup-gnn", mismatch=True, seeds="1", sensor="radar"),
        GridRequest(densities="20", seeds="1", settings=("altered.hide_s=[1,2.5]", "altered.burst_share=0.15")),
    ],
)  # fmt: skip
def test_the_command_of_each_run_asks_for_the_very_same_run(request_):
    for run in plan_grid(request_).runs:
        assert told(command_of(run.config)) == run.config


@pytest.fixture
def grid(tmp_path):
    """Return the folder of a grid of two trackers, two densities and two seeds, without runs of their own."""
    folder = tmp_path / "grid"
    folder.mkdir()
    request = GridRequest(densities="20,45", trackers="mmpf,stonesoup-jpda", seeds="2")
    (folder / "grid.json").write_text(json.dumps(asdict(request)))
    (folder / "table.md").write_text("# Stress\n\n| a | b |\n|---|---|\n| x | 91.5 [90.1, 92.9] |\n")
    runs = plan_grid(request).runs
    columns = {"hidden.hidden_cost_m": 0.5, "hidden.n": 10.0, "occlusion.same_id_percent": 80.0, "mot.hota": 91.0}
    rows = [run.identity() | columns | {"succeeded": True} for run in runs]
    rows[0] |= {"hidden.hidden_cost_m": 1.0, "hidden.n": 30.0}
    rows[2] |= {"hidden.hidden_cost_m": 3.0, "hidden.n": 10.0}
    pd.DataFrame(rows).to_parquet(folder / "runs.parquet")
    return folder, runs


def test_the_page_leads_from_each_cell_to_its_runs_and_tells_their_commands(grid):
    folder, runs = grid
    page = write_page(folder).read_text(encoding="utf-8")
    links = re.findall(r"<a href='#cell-(\d)'>([\d.]+)</a>", page)
    assert [number for number, _ in links] == ["1", "2", "3", "4"]
    assert float(links[0][1]) == 1.5, "the mean of both seeds by their vehicle-steps, as in the curves"
    for number, _ in links:
        assert f'id="cell-{number}"' in page
    commands = re.findall(r"<code class='command'>([^<]*)</code>", page)
    assert sorted(commands) == sorted(command_of(run.config) for run in runs)


def test_a_run_that_was_kept_leads_to_its_page_and_to_both_side_by_side(grid):
    folder, runs = grid
    second = folder / "kept" / runs[1].key
    write_recorded_scene(second)
    (second / "report.html").write_text("")
    (second / BESIDE).write_text("")
    page = write_page(folder).read_text(encoding="utf-8")
    assert f"<a href='kept/{runs[1].key}/report.html'>" in page
    assert f"<a href='kept/{runs[1].key}/{BESIDE}'>beside mmpf residual</a>" in page
    assert page.count("<code class='command'>") == len(runs) - 1


def test_the_page_begins_with_the_verdicts_that_compare_gives(grid, capsys):
    folder, _ = grid
    sides = [f"{folder}@{label}" for label in ("mmpf residual", "stonesoup-jpda")]
    run_command_line(["compare", *sides, "--json", "--quiet"])
    compared = json.loads(capsys.readouterr().out)
    judged = [each for each in compared["verdicts"] if each["primary"] and each["pairs"]]
    page = write_page(folder).read_text(encoding="utf-8")
    section = page[page.index('id="verdicts-heading"') : page.index('id="charts-heading-1"')]
    assert 0 < page.index("ahead of") < page.index('id="verdicts-heading"'), "who is better comes first"
    found = re.findall(r'<td>(\d*)</td>\n<td class="verdict[^>]*><strong>([^<]*)</strong>(?:, )?([^<]*)<', section)
    assert found == [(str(each["pairs"]), each["verdict"], each["wanting"]) for each in judged]
    assert {verdict for _, verdict, _ in found} >= {"undecided"}
    assert html.escape(" ".join(compared["reasons"])) in section


@pytest.mark.parametrize(("lead", "claim"), [(1.0, "it is undecided whether "), (9.0, "")])
def test_the_headline_claims_a_lead_only_where_the_verdict_below_does(grid, lead, claim):
    folder, _ = grid
    table = pd.read_parquet(folder / "runs.parquet")
    table["mot.hota"] -= (table["variant"] != "mmpf") * (lead + 0.01 * table["seed"])  # every interval excludes 0
    table.to_parquet(folder / "runs.parquet")
    said = f"In HOTA in sight, {claim}mmpf residual is ahead of stonesoup-jpda: by {lead:.1f} percentage points"
    assert said in write_page(folder).read_text(encoding="utf-8")


def test_of_edited_runs_the_headline_claims_nothing_and_the_page_says_why_there_are_no_verdicts(grid):
    folder, _ = grid
    write_manifest(folder / "manifest.json", RunFacts("complete", "", 0, 4, {}, files={"runs.parquet": 64 * "0"}))
    page = write_page(folder).read_text(encoding="utf-8")
    assert "There are no verdicts on these runs, since they can't be compared: " in page
    assert "is ahead of" not in page.replace("it is undecided whether mmpf residual is ahead of", "")


def test_the_verdict_of_the_headline_has_its_table_where_the_first_tracker_is_not_among_the_two(grid):
    folder, _ = grid
    request = GridRequest(densities="20", trackers="pmbm,mmpf,oc-sort", seeds="2")
    (folder / "grid.json").write_text(json.dumps(asdict(request)))
    runs = zip(plan_grid(request).runs, 2 * [50.0, 90.0, 80.0], strict=True)
    table = pd.DataFrame(run.identity() | {"mot.hota": score, "succeeded": True} for run, score in runs)
    table.to_parquet(folder / "runs.parquet")
    page = write_page(folder).read_text(encoding="utf-8")
    assert "mmpf residual is ahead of oc-sort" in page
    assert re.findall("<p>a: (.*?), b: (.*?)\\.", page)[-1] == ("mmpf residual", "oc-sort")


def test_kept_runs_get_their_pages_and_each_tracker_stands_beside_the_first(grid):
    folder, runs = grid
    for run in runs[:2]:
        write_recorded_scene(folder / "kept" / run.key, config=run.config, command=command_of(run.config))
    write_kept_pages(folder, quiet=True)
    addresses = re.findall(r"<a href='(kept/[^']*)'", write_page(folder).read_text(encoding="utf-8"))
    own, beside = [[f"kept/{run.key}/{name}" for run in runs[:2]] for name in ("report.html", BESIDE)]
    assert sorted(addresses) == sorted([*own, beside[1]])
    panes = [(folder / address).read_text(encoding="utf-8").count('class="road"') for address in (*own, beside[1])]
    assert panes == [1, 1, 2]
    manifest = json.loads((folder / "kept" / runs[0].key / "manifest.json").read_text())
    assert manifest["command"] == command_of(runs[0].config)


@pytest.mark.slow
def test_a_stress_test_that_keeps_its_runs_links_to_their_pages(tmp_path, no_pictures):
    out = tmp_path / "out"
    words = ["stress", "--densities", "20", "--seeds", "1", "--trackers", "stonesoup-gnn,oracle-kalman"]
    assert run_command_line([*words, "--duration", "2", "--keep", "runs", "--out", str(out), "--quiet"]) == 0
    addresses = re.findall(r"<a href='(kept/[^']*)'", (out / "report.html").read_text(encoding="utf-8"))
    assert len(addresses) == 3
    for address in addresses:
        assert 'class="road"' in (out / address).read_text(encoding="utf-8")
