"""The table of recorded changes of acceleration against a plain loop."""

import numpy as np

from harness.lab.fit.driver_fit import FEWEST, fit_empirical
from mmpf.motion.learned.features import situation
from tests.harness.lab.fit.test_unrolled import windows


def test_a_cell_with_enough_moments_spans_what_was_recorded_in_it():
    led = windows(40, np.random.default_rng(0), pull=0.5)
    table = fit_empirical(led)
    now = slice(None, -1)
    columns = (led.gap_m, led.speed_mps, led.accel_mps2, led.leader_speed_mps, led.leader_accel_mps2)
    cell = table.cells(situation(*(column[:, now].ravel() for column in columns)).T)
    change = np.diff(led.accel_mps2, axis=1).ravel()
    rows = table.changes_mps2.reshape(-1, table.changes_mps2.shape[-1])
    checked = 0
    for number in np.unique(cell):
        recorded = change[cell == number]
        assert np.isfinite(rows[number]).all()
        if len(recorded) >= FEWEST:
            np.testing.assert_allclose(rows[number, [0, -1]], [recorded.min(), recorded.max()], atol=6e-4)
            checked += 1
    assert checked > 10
