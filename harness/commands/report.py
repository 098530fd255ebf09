"""``report``: write the page of a run, or of any folder of results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.config.options import Option


class Options(TypedDict):
    """The options of ``report``."""

    folder: Annotated[
        Path,
        Option(
            "Folder of a run, or of a study, stress grid or comparison.",
            default=...,
            metavar="RUN",
            is_argument=True,
        ),
    ]
    json: Annotated[
        bool, Option("Print the page's path and size as JSON on stdout, nothing else there.", default=False)
    ]


def command(options: Options) -> None:
    """Write RUN/report.html: one file that opens without a network.

    A run's page has a summary in words, numbers with intervals, figures, the
    five worst occlusions, and a replay of the road from above. 'run' writes it
    too; this writes it anew.

    Examples:
      python -m harness report results/us101-mmpf-gmm-d20-s0
    """
    from harness.report.folderpage import write_page  # noqa: PLC0415

    page = write_page(options["folder"])
    size_mb = page.stat().st_size / 1e6
    if options["json"]:
        typer.echo(json.dumps({"page": str(page), "size_mb": round(size_mb, 3)}))
    else:
        typer.echo(f"{page} ({size_mb:.1f} MB)", err=True)
