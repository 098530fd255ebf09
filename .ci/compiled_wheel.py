"""Put compiled kernels into a wheel, and check that a run takes them.

    python .ci/compiled_wheel.py build dist/mmpf_harness-0.2.0-py3-none-any.whl
    python .ci/compiled_wheel.py check dist/mmpf_harness-0.2.0-cp311-cp311-manylinux_2_17_x86_64.whl

``build`` lays the wheel out in a folder, lets runs compile there what they need, moves what numba kept into folders
``compiled`` beside the modules, where ``mmpf.numerics.kernels`` looks first, and packs all of it as a wheel of this
Python version beside the other. With ``--quick`` only the first run does, and it finds what runs of these sources have
compiled: numba knows that by what a source says, not by where it lies. ``check`` lays such a wheel out in a folder that
can't be written to, with an empty home, and says after how many seconds a run does its first step and how many
functions numba compiled; exit code 1 if there are any.

The packages that the wheel needs must be installed, in the versions of ``constraints.txt``: kernels of another version
of numba or Python are not used.
"""

from __future__ import annotations

import argparse
import base64
import compileall
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Kernels call nothing of the system but what numba hands them: any Linux on such a processor will do.
TAG = "cp{0}{1}-cp{0}{1}-manylinux_2_17_x86_64".format(*sys.version_info)
SHORT = ("run", "--quiet", "--duration", "0.5", "--particles", "100")
RUNS = (
    ("--net", "us101"),
    *(("--net", net) for net in ("interchange", "junction", "roundabout")),
    *(("--net", "us101", "--model", model) for model in ("recurrent", "gmm", "cvm")),
    ("--net", "us101", "--update", "max_likelihood"),
)
"""What is compiled: what these runs call. The first is that of the check."""
TIMED = """
import os, resource, sys, time
from mmpf.tracker import MixtureTracker

step = MixtureTracker.step

def timed(*words):
    tracks = step(*words)
    if MixtureTracker.step is timed:
        MixtureTracker.step = step
        ticks = float(open("/proc/self/stat").read().rpartition(")")[2].split()[19])
        waited_s = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
        print(f"first step: {waited_s:.1f} s after the start, {time.process_time():.1f} s of the processor", flush=True)
    return tracks

MixtureTracker.step = timed
from harness.__main__ import main
main()
"""


def main() -> int:
    """Do what the command line says and return its exit code."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("what", choices=("build", "check"))
    words.add_argument("wheel", type=Path)
    words.add_argument("--quick", action="store_true", help="compile only what the first run calls, and here has not")
    told = words.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        package, home = Path(folder) / "package", Path(folder) / "home"
        home.mkdir()
        with zipfile.ZipFile(told.wheel) as wheel:
            wheel.extractall(package)
        if told.what == "check":
            return check(package, home)
        if told.quick:
            take_compiled(package)
        compile_kernels(package, home, RUNS[:1] if told.quick else RUNS)
        sys.stdout.write(f"{packed(package, told.wheel)}\n")
        return 0


def take_compiled(package: Path) -> None:
    """Lay what the sources beside this folder have compiled where numba would have kept it in a package."""
    for kept in (path for name in ("mmpf", "harness") for path in (ROOT / name).rglob("__pycache__/*.nb?")):
        copy = package / kept.relative_to(ROOT)
        copy.parent.mkdir(exist_ok=True)
        shutil.copyfile(kept, copy)


def compile_kernels(package: Path, home: Path, runs: tuple[tuple[str, ...], ...]) -> None:
    """Have runs compile what they call, and lay it where the package looks for it."""
    run([], package, home, "from mmpf.numerics.kernels import LEVEL, config; assert config.CPU_NAME == LEVEL")
    for number, words in enumerate(runs):
        run([*SHORT, *words, "--out", str(home / str(number))], package, home)
    for kept in list(package.rglob("__pycache__/*.nb?")):
        compiled = kept.parents[1] / "compiled"
        compiled.mkdir(exist_ok=True)
        kept.rename(compiled / kept.name)
    for folder in list(package.rglob("__pycache__")):
        shutil.rmtree(folder)


def packed(package: Path, plain: Path) -> Path:
    """Pack a folder as the wheel of this Python version (the binary distribution format, PEP 427)."""
    about = next(package.glob("*.dist-info"))
    said = (about / "WHEEL").read_text()
    said = said.replace("Root-Is-Purelib: true", "Root-Is-Purelib: false")
    (about / "WHEEL").write_text(re.sub("^Tag: .*$", f"Tag: {TAG}", said, flags=re.MULTILINE))
    record, lines = about / "RECORD", []
    record.unlink()
    target = plain.with_name("-".join([*plain.stem.split("-")[:2], TAG]) + ".whl")
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as wheel:
        for path in sorted(path for path in package.rglob("*") if path.is_file()):
            name, content = str(path.relative_to(package)), path.read_bytes()
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            lines.append(f"{name},sha256={digest},{len(content)}\n")
            wheel.write(path, name)
        name = str(record.relative_to(package))
        wheel.writestr(name, "".join([*lines, f"{name},,\n"]))
    return target


def check(package: Path, home: Path) -> int:
    """Run a package that can't be written to and return 1 if numba compiled anything."""
    compileall.compile_dir(package, quiet=1)  # as pip does
    for path in [package, *package.rglob("*")]:
        path.chmod(path.stat().st_mode & 0o7555)
    cache = home / "numba"
    run([*SHORT, *RUNS[0], "--out", str(home / "run")], package, home, TIMED, NUMBA_CACHE_DIR=str(cache))
    compiled = sorted(path.name for path in cache.rglob("*.nbc"))
    sys.stdout.write(f"functions that numba compiled: {len(compiled)} {' '.join(compiled)}\n")
    return 1 if compiled else 0


def run(words: list[str], package: Path, home: Path, program: str = "", **variables: str) -> None:
    """Run the command line of a package that lies in a folder, without what the user has set or keeps."""
    command = [sys.executable, *(("-c", program) if program else ("-m", "harness")), *words]
    if os.geteuid() == 0:
        # Modes of files bind the superuser too without these capabilities.
        command = ["setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner", *command]
    kept = {name: os.environ[name] for name in ("PATH", "LD_LIBRARY_PATH") if name in os.environ}
    subprocess.run(
        command, env={**kept, "HOME": str(home), "PYTHONPATH": str(package), **variables}, cwd=home, check=True
    )


if __name__ == "__main__":
    sys.exit(main())
