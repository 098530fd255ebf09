"""Write anew the library that draws the pages' charts: Vega, Vega-Lite and Vega-Embed in one compressed script.

The script comes from the package vl-convert-python (``dev`` extra); its version in ``constraints.txt`` says which Vega
it is. A slow test fails where the committed script is another.

    python .ci/vega_bundle.py
"""

from __future__ import annotations

import gzip
from pathlib import Path

import vl_convert

PLACE = Path(__file__).parents[1] / "harness/report/vega/vega-embed.js.gz"


def bundle() -> str:
    """Return the script, which defines ``vegaEmbed`` and nothing else."""
    return f"(() => {{{vl_convert.javascript_bundle('window.vegaEmbed = vegaEmbed;')}}})();\n"


def main() -> None:
    """Write the compressed script."""
    PLACE.write_bytes(gzip.compress(bundle().encode("utf-8"), 9, mtime=0))
    print(f"{PLACE}: Vega {vl_convert.get_vega_version()}, {PLACE.stat().st_size} bytes")  # noqa: T201


if __name__ == "__main__":
    main()
