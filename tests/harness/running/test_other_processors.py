"""What stays the same bytes on another processor: traffic and detections; tracks and scores only on one of its kind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

REPOSITORY = Path(__file__).parents[3]
RUN = ("run", "--duration", "2", "--density", "10", "--particles", "50", "--seed", "3", "--quiet")
OTHERS = {
    "another BLAS kernel": {"OPENBLAS_CORETYPE": "Prescott"},
    "no vectors of 512 bits": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    },
}


def run_as(out: Path, environment: dict[str, str]) -> Path:
    words = [sys.executable, "-m", "harness", *RUN, "--out", str(out)]
    # What a processor lacks can't be taken from it, about which NumPy warns.
    environment = {**os.environ, "PYTHONWARNINGS": "ignore", **environment}
    subprocess.run(words, cwd=REPOSITORY, env=environment, check=True)
    return out


@pytest.mark.slow
def test_traffic_and_detections_are_the_same_bytes_on_other_processors_and_tracks_begin_alike(tmp_path):
    here = run_as(tmp_path / "here", {})
    for number, environment in enumerate(OTHERS.values()):
        there = run_as(tmp_path / f"there-{number}", environment)
        for name in ("truth.parquet", "detections.parquet"):
            assert (there / name).read_bytes() == (here / name).read_bytes(), name
        first = [pd.read_parquet(run / "tracks.parquet").query("step < 5") for run in (here, there)]
        assert first[0]["track_id"].tolist() == first[1]["track_id"].tolist()
        assert np.abs(first[0]["lon_m"].to_numpy() - first[1]["lon_m"].to_numpy()).max(initial=0.0) < 0.1
