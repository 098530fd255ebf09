"""Memory that is freed stays with the process, so that it comes back without page faults."""

import subprocess
import sys

import pytest

FAULTS_OF_TEN_STEPS = """
import resource
import numpy as np
{before}
_ = [np.ones(100_000) for _ in range(20)]
del _
start = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    arrays = [np.ones(100_000) for _ in range(20)]
    del arrays
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - start)
"""


def page_faults(before: str) -> int:
    script = FAULTS_OF_TEN_STEPS.format(before=before)
    return int(subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems' allocators are left as they are")
def test_arrays_as_large_as_the_last_steps_cost_no_page_faults() -> None:
    kept = page_faults("from harness.running.follow import keep_freed_memory; keep_freed_memory()")
    usual = page_faults("pass")
    if usual < 10_000:
        pytest.skip("this allocator keeps freed memory anyway")
    assert kept < 0.05 * usual
