"""``from mmpf import ...`` offers every public name, and ``import mmpf`` alone costs nothing."""

import subprocess
import sys

import pytest

import mmpf

HEAVY = {"libsumo", "matplotlib", "numba", "numpy", "pydantic", "sklearn"}


@pytest.mark.parametrize("name", mmpf.__all__)
def test_every_public_name_can_be_imported(name):
    assert getattr(mmpf, name) is not None


def test_a_name_that_does_not_exist_is_refused_as_in_any_module():
    with pytest.raises(AttributeError, match="has no attribute 'no_such_name'"):
        mmpf.no_such_name  # noqa: B018


def loaded_after(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_importing_the_library_loads_nothing_heavy():
    assert not loaded_after("import mmpf") & HEAVY


def test_the_words_of_a_tracker_need_no_compiler_and_the_filter_neither_sumo_nor_pictures():
    words = "Scan, Detections, Tracks, CONFIRMED, HIDDEN, TENTATIVE, check_scan, highway"
    assert not loaded_after(f"from mmpf import {words}") & (HEAVY - {"numpy"})
    assert not loaded_after("from mmpf import MixtureTracker") & {"libsumo", "traci", "matplotlib", "harness"}
