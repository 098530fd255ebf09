"""Truth and detections read from a table are those that were written into it."""

from dataclasses import fields, replace

import numpy as np

from harness.config.model import RunConfig
from harness.running.recorder import ColumnRecorder, detections_of, frame_of
from harness.sensor.observation import Snapshot
from harness.truth.frame import EVERYWHERE, Frame
from mmpf.tracks import Tracks
from tests.harness.stand_ins import SteadyTraffic, observing

SNAPSHOTS = list(observing(SteadyTraffic(steps=3, ego_stay=2))(RunConfig()))


def recorded(snapshot: Snapshot):
    recorder = ColumnRecorder()
    recorder.add(snapshot, Tracks.none())
    return recorder.tables()["truth.parquet"]


def assert_same(read: Frame, written: Frame):
    for field in fields(Frame):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(written, field.name), field.name)


def test_every_frame_comes_back_as_it_was():
    for snapshot in SNAPSHOTS:
        assert snapshot.frame.window_m == EVERYWHERE
        assert_same(frame_of(recorded(snapshot)), snapshot.frame)


def test_the_window_that_is_on_record_comes_back():
    framed = replace(SNAPSHOTS[0], frame=replace(SNAPSHOTS[0].frame, window_m=(-3.5, 640.0)))
    assert_same(frame_of(recorded(framed)), framed.frame)


def test_a_frame_without_ego_says_so():
    assert frame_of(recorded(SNAPSHOTS[0]).assign(is_ego=False)).ego == -1


def test_what_detections_say_of_noise_and_class_comes_back_and_old_tables_say_nothing_of_either():
    snapshot = next(snapshot for snapshot in SNAPSHOTS if len(snapshot.observation.scan.detections))
    plain = snapshot.observation.scan.detections
    told = replace(plain, correlation=np.linspace(-0.5, 0.5, len(plain)), vehicle_class=np.arange(len(plain)) % 6)
    for detections in (plain, told):
        scan = replace(snapshot.observation.scan, detections=detections)
        recorder = ColumnRecorder()
        recorder.add(replace(snapshot, observation=replace(snapshot.observation, scan=scan)), Tracks.none())
        read = detections_of(recorder.tables()["detections.parquet"])
        assert (read.correlation is None) == (detections.correlation is None)
        np.testing.assert_array_equal(read.covariance_m2, detections.covariance_m2)
        np.testing.assert_array_equal(read.vehicle_class, detections.vehicle_class)
