"""``compare``: whether one run, or grid of runs, is better or worse than another."""

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``compare``."""

    folders: Annotated[
        list[str] | None,
        Option(
            "A and B: folders of runs, stress tests or drives; one tracker of a grid as FOLDER@LABEL.",
            metavar="FOLDER",
            is_argument=True,
        ),
    ]
    baseline: Annotated[str | None, Option("Compare the given folder with this one. (with --suite: results/reference)")]
    suite: Annotated[str | None, Option("Run this suite first, then compare its result: standard.")]
    record: Annotated[bool, Option("Save the suite's result as the baseline; compare nothing.", default=False)]
    out: Annotated[Path | None, Option("Folder for the suite's runs. (default: results/suite)")]
    resume: Annotated[bool, Option("Reuse finished runs of the suite in --out.", default=False)]
    workers: shared.Workers
    gate: Annotated[
        Path | None,
        Option(
            "TOML file: a table metrics.KEY for each judged metric, with tolerance, floor (B is worse if its mean is "
            "below it) and ceiling (if above); tolerance, time_tolerance and allow_undecided for all. Example: "
            "docs/tutorials/gate.md."
        ),
    ]
    tolerance: Annotated[
        float | None, Option("Accepted loss, a share of A's value. (default: 0.02)", metavar="SHARE", least=0, most=1)
    ]
    time_tolerance: Annotated[
        float | None,
        Option(
            "The same for the time per step, in one stress test. (default: 0.25)", metavar="SHARE", least=0, most=100
        ),
    ]
    primary: Annotated[
        str | None,
        Option(
            "Metrics that get a verdict, separated by commas; your own as MODULE:KEY. Others are only in the files of "
            "--html and --markdown. "
            "(default: mot.hota, hidden.hidden_cost_m, occlusion.same_id_percent, hidden.hidden_crps_m, "
            "in_plain_view.recall, in_plain_view.worst_tenth; for drives drive.collided_percent, "
            "drive.ttc_below_1_5_percent, drive.hard_brakes_per_km)"
        ),
    ]
    allow_undecided: Annotated[bool, Option("Exit with code 0 instead of 4 if the result is undecided.", default=False)]
    allow_different: Annotated[
        bool, Option("Compare even if the experiments differ, and list the differences.", default=False)
    ]
    markdown: Annotated[Path | None, Option("Write the tables to this Markdown file.")]
    html: Annotated[
        Path | None,
        Option("Write the tables to this HTML page; two runs on the same detections are shown side by side."),
    ]
    junit: Annotated[Path | None, Option("Write one test case per verdict to this JUnit XML file.")]
    summary: Annotated[Path | None, Option("Write the verdicts, short enough for a comment, to this Markdown file.")]
    pages: Annotated[str | None, Option("Base address of the folders' pages, for the links in --summary.")]
    force: Annotated[bool, Option("Replace existing files, even if another program wrote them.", default=False)]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> int:
    """Decide whether B is worse than A, no worse, or undecided.

    HOTA in sight, hidden cost and CRPS, identities after occlusion and tracks
    in plain view get a verdict, and within one stress test the time per step.
    "worse": B is clearly worse by more than the tolerance, after a correction
    for the number of verdicts. "no worse": no value in the 95 % interval is
    worse by more than the tolerance. Otherwise "undecided", with the number
    of seeds that would decide. False hidden tracks have a row without a
    verdict. Other metrics are only in the files of --html and --markdown.
    Stress tests are paired by seed and setting, two single runs by vehicle,
    and drives ('drive') by episode, on collisions, short times to collision
    and hard brakes.
    Exit code 0: no worse. 1: worse. 4: undecided, or runs or values are missing.

    Examples:
      python -m harness compare results/before results/after
      python -m harness compare results/after --baseline results/reference
      python -m harness compare 'results/a@mmpf cvm' 'results/a@mmpf gmm'
      python -m harness compare --suite standard --markdown comment.md
      python -m harness compare --suite standard --record
      python -m harness compare base head --gate gate.toml --junit gate.xml
    """
    from harness.commands.actions.compare_sides import compare_sides  # noqa: PLC0415

    return compare_sides(options)
