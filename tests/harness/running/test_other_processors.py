"""Traffic, detections and, on processors of the level x86-64-v3, tracks are the same bytes on another processor."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[3]
RUN = """
import sys
from pathlib import Path
from harness.running.resolve import resolve_run_config
from harness.running.run import run
options = {"duration": 2.0, "density": 10.0, "particles": 50, "seed": 3}
run(resolve_run_config(options=options), out=Path(sys.argv[1]))
"""
OTHERS = {
    "another BLAS kernel": {"OPENBLAS_CORETYPE": "Prescott"},
    "no vectors of 512 bits": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    },
}


def run_as(out: Path, environment: dict[str, str]) -> Path:
    words = [sys.executable, "-c", RUN, str(out)]
    # What a processor lacks can't be taken from it, about which NumPy warns.
    environment = {**os.environ, "PYTHONWARNINGS": "ignore", **environment}
    subprocess.run(words, cwd=REPOSITORY, env=environment, check=True)
    return out


@pytest.mark.slow
def test_traffic_detections_and_tracks_are_the_same_bytes_on_other_processors(tmp_path):
    here = run_as(tmp_path / "here", {})
    for number, environment in enumerate(OTHERS.values()):
        there = run_as(tmp_path / f"there-{number}", environment)
        for name in ("truth.parquet", "detections.parquet", "tracks.parquet"):
            assert (there / name).read_bytes() == (here / name).read_bytes(), name
