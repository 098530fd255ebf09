"""Kernels that come with a package are taken as they are, if they are of the same source and processor."""

import os
import subprocess
import sys

import pytest

MODULE = """
import numba
from mmpf.numerics.kernels import kernel
twice = kernel()(lambda x: 2.0 * x)
print(twice(21.0), sum(twice.stats.cache_hits.values()), numba.config.CPU_NAME)
"""


def said(path, **variables: str) -> list[str]:
    environment = {**os.environ, "HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null", "NUMBA_CACHE_DIR": ""}
    return subprocess.check_output([sys.executable, str(path)], env=environment | variables, text=True).split()


@pytest.mark.slow
def test_a_kernel_that_comes_with_its_module_is_not_compiled_where_nothing_can_be_written(tmp_path):
    path, kept = tmp_path / "module.py", tmp_path / "__pycache__"
    path.write_text(MODULE)
    assert said(path)[:2] == ["42.0", "0"]
    kept.rename(tmp_path / "compiled")
    kept.touch()
    assert said(path)[:2] == ["42.0", "1"]
    assert said(path, NUMBA_CPU_NAME="generic") == ["42.0", "0", "generic"]
    path.write_text(MODULE.replace("2.0", "3.0"))
    assert said(path)[:2] == ["63.0", "0"]
