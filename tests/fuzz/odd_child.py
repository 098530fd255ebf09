"""The process in which odd networks are driven on, one after the other: a line of JSON before and after each."""

from __future__ import annotations

import faulthandler
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

from harness.report import pictures
from tests.fuzz.child import captured
from tests.fuzz.odd_networks import chosen


def main() -> None:
    """Drive on the networks from a number up to another, and tell of them in a file; all three are given."""
    first, end, told = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    faulthandler.enable()
    pictures.draw_charts = lambda *_: None  # of errors over time; no network shows in them
    errors, home = told.with_suffix(".stderr"), Path.cwd()
    with told.open("a", encoding="utf-8") as log:
        for number, (name, make) in list(enumerate(chosen().items()))[first:end]:
            log.write(json.dumps({"begin": number, "kind": "network", "command": [name], "spoilt": [name]}) + "\n")
            log.flush()
            folder = Path(tempfile.mkdtemp(prefix=f"odd-{number}-"))
            os.chdir(folder)
            words = ["run", "--net", str(make().write(folder)), "--duration", "1", "--particles", "30"]
            code = captured([*words, "--out", "run", "--quiet"], errors)
            message = errors.read_text(encoding="utf-8", errors="replace")
            log.write(json.dumps({"end": number, "code": code, "seconds": 0.0, "stderr": message[-4000:]}) + "\n")
            log.flush()
            os.chdir(home)
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
