from __future__ import annotations

import sys

import numpy as np
import pytest

from harness.errors import UserError
from harness.trackers.catalogue import available_trackers, build_tracker
from harness.trackers.checks import TrackerCheck, tracker_checks
from harness.trackers.protocol import TrackerSetting, TruthAssociatedTracker
from harness.trackers.scripted_scenes import ROAD, SENSOR

CONFORMING = [name for name in available_trackers() if name != "mmpf"]


def setting() -> TrackerSetting:
    return TrackerSetting(ROAD, SENSOR, np.random.default_rng(0))


@pytest.mark.parametrize("check", tracker_checks(), ids=str)
@pytest.mark.parametrize("name", CONFORMING)
def test_every_built_in_tracker_conforms(name: str, check: TrackerCheck):
    if name.startswith("stonesoup"):
        pytest.importorskip("stonesoup")
    check(lambda setting, options: build_tracker(name, setting, options))


def test_only_the_oracle_is_told_the_association():
    assert isinstance(build_tracker("oracle-kalman", setting(), {}), TruthAssociatedTracker)
    pytest.importorskip("stonesoup")
    assert not isinstance(build_tracker("stonesoup-jpda", setting(), {}), TruthAssociatedTracker)


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(
        UserError, match=r"--tracker kalmann: unknown; choose one of mmpf, oracle-kalman, stonesoup-gnn"
    ):
        build_tracker("kalmann", setting(), {})


def test_a_missing_extra_is_answered_with_its_installation(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(sys.modules, "harness.trackers.stonesoup_trackers", raising=False)
    monkeypatch.setitem(sys.modules, "stonesoup.dataassociator.neighbour", None)
    with pytest.raises(UserError, match=r"pip install 'mmpf-harness\[baselines\]'"):
        build_tracker("stonesoup-gnn", setting(), {})


def test_a_wrong_option_is_named():
    with pytest.raises(UserError, match=r"tracker option 'lon_nois' of oracle-kalman"):
        build_tracker("oracle-kalman", setting(), {"lon_nois": 1.0})
    with pytest.raises(UserError, match=r"tracker option 'lon_noise' of oracle-kalman.*greater than 0"):
        build_tracker("oracle-kalman", setting(), {"lon_noise": -1.0})


@pytest.mark.parametrize("path", ["no_such_package.module:make", "harness.trackers.oracle:no_such_factory"])
def test_a_dotted_path_that_leads_nowhere_is_refused(path: str):
    with pytest.raises(UserError, match=path):
        build_tracker(path, setting(), {})


def test_a_dotted_path_builds_ones_own_tracker():
    built = build_tracker("harness.trackers.oracle:build_oracle_kalman", setting(), {"lon_noise": 2.0})
    assert isinstance(built, TruthAssociatedTracker)
