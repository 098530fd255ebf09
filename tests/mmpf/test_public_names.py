"""Whoever only writes a tracker waits for no compiler; ``tests/test_public_paths.py`` looks at the names themselves."""

import subprocess
import sys

HEAVY = {"libsumo", "matplotlib", "numba", "pydantic", "sklearn"}


def test_the_words_of_a_tracker_need_no_compiler():
    words = "Scan, Detections, Tracks, CONFIRMED, HIDDEN, TENTATIVE, check_scan, highway"
    code = f"from mmpf import {words}; import sys; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(run.stdout.split()) & HEAVY
