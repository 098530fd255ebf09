"""Truth and detections read from a table are those that were written into it."""

from dataclasses import fields, replace

import numpy as np

from harness.config.model import RunConfig
from harness.running.recorder import ColumnRecorder, detections_of, frame_of
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


def test_what_detections_say_of_noise_and_class_comes_back_and_old_tables_say_nothing_of_either():
    look = next(look for look in LOOKS if len(look.observation.scan.detections))
    plain = look.observation.scan.detections
    told = replace(plain, correlation=np.linspace(-0.5, 0.5, len(plain)), vehicle_class=np.arange(len(plain)) % 6)
    for detections in (plain, told):
        scan = replace(look.observation.scan, detections=detections)
        recorder = ColumnRecorder()
        recorder.add(replace(look, observation=replace(look.observation, scan=scan)), Tracks.none())
        read = detections_of(recorder.tables().detections)
        assert (read.correlation is None) == (detections.correlation is None)
        np.testing.assert_array_equal(read.covariance_m2, detections.covariance_m2)
        np.testing.assert_array_equal(read.vehicle_class, detections.vehicle_class)
