"""``report``: write the page of a run, or of any folder of results."""

import json
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.common.error_text import drawing
from harness.config import options as shared
from harness.config.options import Option
from harness.storage.manifest import tell_edited


class Options(TypedDict):
    """The options of ``report``."""

    folder: Annotated[
        Path,
        Option("Folder of a run, stress test, drive or study.", default=..., metavar="RUN", is_argument=True),
    ]
    figures: Annotated[
        str | None, Option("Draw the figures of a run or a stress test for a paper: png, svg or pdf.", metavar="KIND")
    ]
    json: shared.Json


def command(options: Options) -> None:
    """Write RUN/report.html: one file that opens offline.

    A run's page has a top-view replay, key figures with intervals, a summary,
    the worst failures and figures. 'run' writes this page too.
    --figures writes figures to RUN/figures: errors over time and by
    visibility, the tracker's state and the worst occlusions; for a stress
    test, its curves.

    Examples:
      python -m harness report results/first
      python -m harness report results/stress --figures pdf
    """
    from harness.report.folder_page import write_page  # noqa: PLC0415

    if options["figures"] is not None:
        with drawing("figures"):
            from harness.report.pictures import write_pictures  # noqa: PLC0415

            pictures = write_pictures(options["folder"], options["figures"])
        for picture in pictures:
            typer.echo(str(picture), err=True)
    page = write_page(options["folder"])
    tell_edited(options["folder"], "folder")
    size_mb = page.stat().st_size / 1e6
    if options["json"]:
        typer.echo(json.dumps({"page": str(page), "size_mb": round(size_mb, 3)}))
    else:
        typer.echo(f"{page} ({size_mb:.1f} MB)", err=True)
