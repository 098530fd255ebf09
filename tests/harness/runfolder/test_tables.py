"""Truth read from a table is the truth that was written into it."""

from dataclasses import fields, replace

import numpy as np

from harness.config.model import RunConfig
from harness.runfolder.tables import ColumnRecorder, frame_of
from harness.sensor.observation import Look
from harness.truth.frame import EVERYWHERE, Frame
from mmpf.tracks import Tracks
from tests.harness.stand_ins import SteadyTraffic, looking_at

LOOKS = list(looking_at(SteadyTraffic(steps=3, ego_stay=2))(RunConfig()))


def recorded(look: Look):
    recorder = ColumnRecorder()
    recorder.add(look, Tracks.none())
    return recorder.tables().truth


def assert_same(read: Frame, written: Frame):
    for field in fields(Frame):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(written, field.name), field.name)


def test_every_frame_comes_back_as_it_was():
    for look in LOOKS:
        assert look.frame.window_m == EVERYWHERE
        assert_same(frame_of(recorded(look)), look.frame)


def test_the_window_that_is_on_record_comes_back():
    framed = replace(LOOKS[0], frame=replace(LOOKS[0].frame, window_m=(-3.5, 640.0)))
    assert_same(frame_of(recorded(framed)), framed.frame)


def test_a_frame_without_ego_says_so():
    assert frame_of(recorded(LOOKS[0]).assign(is_ego=False)).ego == -1
