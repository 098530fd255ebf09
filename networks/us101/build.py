"""Rebuild us101.net.xml from its sources: ``python networks/us101/build.py`` (needs the ``networks`` extra)."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCE = HERE / "source"
BUILT = HERE / "us101.net.xml"


def build() -> None:
    """Run netconvert on the plain-XML sources and strip the lines that change from build to build."""
    from sumo import SUMO_HOME  # noqa: PLC0415  (only this script needs the large package)

    subprocess.run(
        [
            str(Path(SUMO_HOME) / "bin" / "netconvert"),
            *("--node-files", str(SOURCE / "us101.nod.xml")),
            *("--edge-files", str(SOURCE / "us101.edg.xml")),
            *("--type-files", str(SOURCE / "us101.typ.xml")),
            *("--connection-files", str(SOURCE / "us101.con.xml")),
            *("--output-file", str(BUILT)),
            "--offset.disable-normalization",
            "--no-turnarounds",
            "--no-internal-links",
            *("--junctions.limit-turn-speed", "-1"),
            *("--default.junctions.radius", "0"),
            *("--geometry.max-angle.fix", "false"),
            *("--precision", "3"),
        ],
        check=True,
    )
    BUILT.write_text(without_build_stamp(BUILT.read_text(encoding="utf-8")), encoding="utf-8")


def without_build_stamp(text: str) -> str:
    """Return the network without the comment that netconvert writes with the time and the builder's paths."""
    return re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)


if __name__ == "__main__":
    build()
