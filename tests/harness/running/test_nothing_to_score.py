"""A run without anything to be scored on is none: numbers over nothing are worse than no numbers."""

import pytest

from harness.common.errors import InputError
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from tests.harness.stand_ins import SteadyTraffic, observing

ECHO = "tests.harness.stand_ins:echo_tracker"
NOBODY = ("sensor.range_m=1.0",)
BLIND = ("sensor.detection_probability=0.0", "sensor.clutter_per_scan=0.0")


@pytest.mark.parametrize(("settings", "reason"), [(NOBODY, "range"), (BLIND, "detected")])
def test_a_run_that_sees_nobody_is_refused_with_the_reason_and_leaves_nothing(settings, reason, tmp_path):
    config = resolve_run_config(options={"tracker": ECHO}, settings=settings)
    with pytest.raises(InputError, match=f"nothing can be scored.*{reason}"):
        run(config, out=tmp_path / "run", open_snapshots=observing(SteadyTraffic(steps=8)))
    assert not list(tmp_path.iterdir())
