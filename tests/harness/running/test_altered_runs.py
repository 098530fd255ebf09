"""Altered detections of finished runs and of live ones, by the configuration."""

import numpy as np

from harness.config.model import RunConfig
from harness.running.resolve import resolve_run_config
from harness.running.snapshots import RandomStreams


def test_what_is_not_altered_leaves_no_trace_in_the_configuration():
    assert "altered" not in RunConfig().as_table()
    config = resolve_run_config(None, {}, ["altered.burst_share=0.15"])
    assert config.as_table()["altered"]["burst_share"] == 0.15


def test_the_stream_of_alterations_leaves_the_other_three_as_they_were():
    streams = RandomStreams.from_seed(7)
    three = np.random.SeedSequence(7).spawn(3)
    for mine, old in zip((streams.truth, streams.sensor, streams.tracker), three, strict=True):
        assert (mine.generate_state(4) == old.generate_state(4)).all()
