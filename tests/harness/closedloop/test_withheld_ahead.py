"""Is the vehicle right ahead of a driven ego withheld?"""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.closedloop.beliefs import true_bodies
from harness.closedloop.withheld_ahead import PlainSight
from harness.sensor.observation import Snapshot
from harness.storage.schema import PARTIAL, VISIBLE
from tests.harness.closedloop.frames import frame_of


def snapshot_of(step, state=VISIBLE):
    frame = frame_of([0.0, 30.0], [0.0, 0.0], step=step)
    return Snapshot(frame, SimpleNamespace(state=np.array([VISIBLE, state], dtype=np.int8)))


def told(lon=None):
    bodies = true_bodies(frame_of([0.0, 30.0 if lon is None else lon], [0.0, 0.0]))
    return bodies if lon is not None else true_bodies(frame_of([0.0], [0.0]))


def test_it_is_withheld_from_half_a_second_in_plain_view_on():
    sight, found = PlainSight(), []
    for step in range(8):
        snapshot = snapshot_of(step)
        sight.note(snapshot)
        found.append(sight.withholds(snapshot, 1, told()))
    assert found == [False] * 5 + [True] * 3


def test_an_interruption_begins_the_time_anew():
    sight = PlainSight()
    for step, state in enumerate([VISIBLE] * 6 + [PARTIAL] + [VISIBLE] * 5):
        snapshot = snapshot_of(step, state)
        sight.note(snapshot)
    assert not sight.withholds(snapshot, 1, told())


@pytest.mark.parametrize(("lon", "withheld"), [(34.0, False), (34.1, True), (26.0, False), (25.9, True)])
def test_whoever_is_told_of_something_within_the_gate_is_not_withheld(lon, withheld):
    sight = PlainSight()
    for step in range(6):
        snapshot = snapshot_of(step)
        sight.note(snapshot)
    assert sight.withholds(snapshot, 1, told(lon)) is withheld
