import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.trackers.catalogue import available_trackers, build_tracker
from harness.trackers.conformance.checks import TrackerCheck, tracker_checks
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR
from harness.trackers.protocol import TrackerSetting, TruthAssociatedTracker

FEWER = {"particles": 200}
# The published rule weighs components by products over time: some starve, and their vehicles go without a track.
BEYOND_THE_PUBLISHED_RULE = {
    "identities_stay_with_their_cars",
    "identities_stay_on_a_bend",
    "identities_stay_at_a_crossing",
}
STARVES = pytest.mark.xfail(reason="components starve under the published rule", strict=True)
# A baseline without memory can keep no identity.
BEYOND_MEMORYLESS = BEYOND_THE_PUBLISHED_RULE | {"one_car_becomes_one_confirmed_track"}
ASKED_OF_ALL = {
    "tracks_are_well_formed",
    "identities_stay_with_their_cars",
    "scans_are_left_as_they_were",
    "steps_of_1_s",
    "two_detections_at_one_point",
}
"""What the fast tests ask of all trackers; of one they ask everything, and Stone Soup's others share most with one."""


def is_slow(name: str, check: TrackerCheck) -> bool:
    beside_gnn = is_made_of_stone_soup(name) and name != "stonesoup-gnn"
    return beside_gnn or (check.name not in ASKED_OF_ALL and name != "pmbm")


def is_made_of_stone_soup(name: str) -> bool:
    return name.startswith("stonesoup") or name == "immortal-kalman"


def setting() -> TrackerSetting:
    return TrackerSetting(ROAD, SENSOR, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "check"),
    [
        pytest.param(name, check, marks=pytest.mark.slow if is_slow(name, check) else (), id=f"{name}-{check}")
        for name in available_trackers()
        for check in tracker_checks()
        if name != "detections"
    ],
)
def test_every_built_in_tracker_conforms(name: str, check: TrackerCheck):
    if is_made_of_stone_soup(name):
        pytest.importorskip("stonesoup")
    if name == "lmb":
        pytest.importorskip("multisensor_lmb_filters_rs")
    check(lambda setting, options: build_tracker(name, setting, options), FEWER if name == "mmpf" else {})


@pytest.mark.parametrize("check", [each for each in tracker_checks() if each.name not in BEYOND_MEMORYLESS], ids=str)
def test_the_baseline_conforms_but_for_its_identities(check: TrackerCheck):
    check(lambda setting, options: build_tracker("detections", setting, options))


@pytest.mark.slow
@pytest.mark.parametrize(
    "check",
    [pytest.param(each, marks=STARVES if each.name in BEYOND_THE_PUBLISHED_RULE else ()) for each in tracker_checks()],
    ids=str,
)
def test_the_published_rule_conforms_but_for_its_starving_components(check: TrackerCheck):
    check(lambda setting, options: build_tracker("mmpf", setting, options), {"update": "max_likelihood", **FEWER})


def test_only_the_oracle_is_told_the_association():
    assert isinstance(build_tracker("oracle-kalman", setting(), {}), TruthAssociatedTracker)
    pytest.importorskip("stonesoup")
    assert not isinstance(build_tracker("stonesoup-jpda", setting(), {}), TruthAssociatedTracker)


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        (
            "kalmann",
            {},
            "`tracker` kalmann: unknown; choose one of box-kalman, detections, immortal-kalman, lmb, mmpf, ",
        ),
        ("mmpf", {"joint": {"gate_std": 4.0}}, r"'joint.gate_std' of mmpf.*did you mean joint\.association\.gate_std"),
        ("oracle-kalman", {"lon_nois": 1.0}, r"'lon_nois' of oracle-kalman.*did you mean lon_noise"),
        ("oracle-kalman", {"zzz": 1.0}, r"'zzz' of oracle-kalman.*known are lon_noise, lat_noise"),
        ("no_such_package.module:make", {}, "no_such_package.module:make"),
        ("harness.trackers.oracle:no_such_factory", {}, "harness.trackers.oracle:no_such_factory"),
    ],
)
def test_a_name_or_option_that_there_is_not_is_answered_with_those_that_there_are(name, options, told):
    with pytest.raises(InputError, match=told):
        build_tracker(name, setting(), options)


def test_a_missing_extra_is_answered_with_its_installation(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(sys.modules, "harness.trackers.stonesoup.trackers", raising=False)
    monkeypatch.setitem(sys.modules, "stonesoup.dataassociator.neighbour", None)
    with pytest.raises(InputError, match=r"pip install -c constraints.txt '\.\[baselines\]'"):
        build_tracker("stonesoup-gnn", setting(), {})


def committed_model(name: str) -> Path:
    return Path(str(files("mmpf.models").joinpath(name)))


@pytest.mark.parametrize(("model", "file"), [("gmm", "lane_keeping.npz"), ("gmm-short", "lane_keeping_short.npz")])
def test_a_model_can_come_from_a_file_of_ones_own(model: str, file: str):
    build_tracker("mmpf", setting(), {"model": model, "model_file": str(committed_model(file))})


def test_a_damaged_model_file_is_refused_in_one_line_that_names_it(tmp_path: Path):
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(committed_model("lane_keeping.npz").read_bytes()[:-200])
    for file in (damaged, tmp_path / "none.npz", committed_model("lane_keeping_short.npz")):
        with pytest.raises(ValueError, match=file.name) as refusal:
            build_tracker("mmpf", setting(), {"model": "gmm", "model_file": str(file)})
        assert "\n" not in str(refusal.value)


def test_a_model_file_for_a_model_without_one_is_refused():
    with pytest.raises(ValueError, match=r"model_file.*'cvm'.*gmm"):
        build_tracker("mmpf", setting(), {"model": "cvm", "model_file": "some.npz"})
