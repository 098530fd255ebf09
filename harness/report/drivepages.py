"""The page of a closed loop, and those of its hardest collisions, to which it leads."""

from __future__ import annotations

from harness.closedloop.drive import FinishedDrives
from harness.common.progress import progress_bar
from harness.grid.gridfolder import KEPT
from harness.report.folderpage import write_page
from harness.report.page import PAGE, write_run_page
from harness.runfolder import folder as runfolder


def write_drive_pages(finished: FinishedDrives, quiet: bool) -> None:
    """Write the pages of the collisions that the tables lead to, as far as they are not there, then the folder's."""
    folders = [finished.folder / KEPT / key for key in finished.shown]
    with progress_bar("pages of the collisions", len(folders), quiet) as advance:
        for folder in folders:
            if (folder / runfolder.MANIFEST).is_file() and not (folder / PAGE).is_file():
                write_run_page(folder)
            advance()
    write_page(finished.folder)
