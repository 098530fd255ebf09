"""Small recordings in the layouts that are read, written by the tests' own generators: nothing of a data set."""

from __future__ import annotations

import sys
from pathlib import Path

from same_results_digests import of_folder, of_text

ROOT = Path(__file__).resolve().parents[1]


def write_recordings(folder: Path) -> str:
    """Write them into ``recordings`` of a folder and return a digest of all.

    Both revisions read what the working tree's generators write.
    """
    sys.path.insert(0, str(ROOT))
    from tests.harness.truth.recorded.crossing import write_crossing  # noqa: PLC0415
    from tests.harness.truth.recorded.detected.made import write_kitti  # noqa: PLC0415
    from tests.harness.truth.recorded.layouts import (  # noqa: PLC0415
        write_commonroad,
        write_fcd,
        write_highd,
        write_ngsim_csv,
        write_ngsim_text,
    )

    recordings = folder / "recordings"
    recordings.mkdir(parents=True)
    write_ngsim_csv(recordings / "ngsim.csv")
    write_ngsim_text(recordings / "ngsim.txt")
    write_commonroad(recordings / "straight.xml")
    write_crossing(recordings / "crossing.xml")
    write_highd(recordings / "highd")
    write_fcd(recordings / "traffic.xml")
    write_kitti(recordings / "kitti")
    return of_text(repr(sorted(of_folder(recordings, ()).items())))
