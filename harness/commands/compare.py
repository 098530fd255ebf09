"""``compare``: whether one run, or grid of runs, is better or worse than another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``compare``."""

    folders: Annotated[
        list[str] | None,
        Option(
            "Folders of runs, stress tests or drives; one tracker of a grid as FOLDER@LABEL.",
            metavar="A [B]",
            is_argument=True,
        ),
    ]
    baseline: Annotated[str | None, Option("Compare the one folder with this one. (with --suite: results/reference)")]
    suite: Annotated[str | None, Option("Run this suite first and compare it: standard.")]
    record: Annotated[bool, Option("Keep the suite's result as the baseline, compare nothing.", default=False)]
    out: Annotated[Path, Option("Folder for the suite's runs.", default=Path("results/suite"))]
    resume: Annotated[bool, Option("Keep the suite's runs that --out holds.", default=False)]
    workers: shared.Workers
    gate: Annotated[
        Path | None, Option("TOML file of metrics with tolerances, floors and ceilings: see docs/tutorials/gate.md.")
    ]
    tolerance: Annotated[
        float | None, Option("Share of a's value by which b may be worse. (default: 0.02)", least=0.0, most=1.0)
    ]
    time_tolerance: Annotated[
        float | None,
        Option("Likewise of the time of a step, judged within one stress test. (default: 0.25)", least=0.0, most=100.0),
    ]
    primary: Annotated[
        str | None,
        Option(
            "Metrics that get a verdict, with commas between; the others are described. "
            "(default: mot.hota,hidden.hidden_cost_m,occlusion.same_id_percent,in_plain_view.recall,"
            "in_plain_view.worst_tenth; of drives by belief "
            "drive.collided_percent,drive.ttc_below_1_5_percent,drive.hard_brakes_per_km)"
        ),
    ]
    allow_undecided: Annotated[bool, Option("Exit code 0, not 4, where it stays undecided.", default=False)]
    allow_different: Annotated[bool, Option("Compare different experiments too, and list what differs.", default=False)]
    markdown: Annotated[Path | None, Option("Write the tables to this Markdown file.")]
    html: Annotated[
        Path | None,
        Option("Write them as a page to this file, two runs on the same detections side by side."),
    ]
    junit: Annotated[Path | None, Option("Write a test case for each verdict to this file, as JUnit's XML.")]
    summary: Annotated[Path | None, Option("Write what is judged, short enough for a comment, to this Markdown file.")]
    pages: Annotated[str | None, Option("Address below which the folders' pages lie, for links in --summary.")]
    force: Annotated[bool, Option("Replace files that are there, whoever wrote them.", default=False)]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> int:
    """Tell whether B is worse than A, no worse, or whether that stays undecided.

    HOTA in sight, hidden cost and same identity get a verdict, and within one
    stress test the time of a step: "worse" beyond the tolerance, corrected
    for the number of verdicts; "no worse" where the whole 95 % interval lies
    within the tolerance; else "undecided", with how many more seeds would
    decide it. Other metrics are described. Runs are paired by seed and
    setting; two single runs, by vehicle; drives by belief ('drive') by
    episode, on collisions, short times to collision and hard brakes.
    Exit code 0: no worse. 1: worse. 4: undecided, or runs or values are missing.

    Examples:
      python -m harness compare results/before results/after
      python -m harness compare results/after --baseline results/reference
      python -m harness compare 'results/stress@mmpf cvm' 'results/stress@mmpf gmm'
      python -m harness compare --suite standard --markdown comment.md
      python -m harness compare --suite standard --record
      python -m harness compare base head --gate gate.toml --junit gate.xml
    """
    from harness.commands.actions.compare_sides import compare_sides  # noqa: PLC0415

    return compare_sides(options)
