"""Makes the closed-loop drives and the pages of their folder."""

import os
import sys
from collections.abc import Mapping

from harness.closedloop.drive import Execution, FinishedDrives, run_drives
from harness.closedloop.options import DriveOptions
from harness.closedloop.plan import DARK, request_of
from harness.common.errors import InputError
from harness.common.markdown import show_markdown
from harness.common.progress import progress_bar
from harness.config.options import checked
from harness.grid.making import on_stderr
from harness.report.folder_page import write_page
from harness.report.page import PAGE, write_run_page
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import KEPT
from harness.truth.network.network import load_network


def make_drives(options: Mapping[str, object], command: str, quiet: bool) -> FinishedDrives:
    """Drive as ``DriveOptions`` say, by name, and write the folder and its pages; ``command`` is for the manifest."""
    values = checked(DriveOptions, options, "drive")
    request = request_of(values)
    if request.detected is not None and DARK not in request.provoke:
        raise InputError(f"`detected`: only `provoke` {DARK} uses it; leave it out, or add {DARK} to `provoke`")
    if request.heed_unseen is not None and load_network(request.net).corridor is not None:
        raise InputError(f"`heed_unseen`: {request.net} has no crossings; leave it out, or name another `net`")
    workers = values["workers"] or os.cpu_count() or 1
    how = Execution(workers, values["timeout_per_run"], values["resume"], values["retry_failed"])
    finished = run_drives(request, values["out"], how, on_stderr(quiet), command)
    # The pages of the collisions that the tables lead to, as far as they are not there, then the folder's.
    folders = [finished.folder / KEPT / key for key in finished.shown]
    with progress_bar("pages of the collisions", len(folders), quiet) as advance:
        for folder in folders:
            if (folder / runfolder.MANIFEST).is_file() and not (folder / PAGE).is_file():
                write_run_page(folder)
            advance()
    write_page(finished.folder)
    return finished


def tell(finished: FinishedDrives) -> None:
    """Print the results and the table of all episodes on stderr, and the paths of other files."""
    show_markdown("\n## ".join(finished.text.split("\n## ")[:2]), on_stderr=True)
    sys.stderr.write(f"By kind of episode, with each collision: {finished.folder / PAGE}\n")
