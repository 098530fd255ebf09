"""Neither update rule leans on the other's settings; what both use is in a group of its own."""

import math
from dataclasses import fields

import numpy as np
import pytest

from mmpf.motion import motion_model
from mmpf.options.base import Settings
from mmpf.options.filter import FilterOptions
from mmpf.options.joint import JointOptions
from mmpf.options.paper import MaxLikelihoodOptions
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from mmpf.tracks import HIDDEN, Tracks
from tests.mmpf.scenes import ROAD, ego_at, lane_centre, scan_of

OWN_GROUP = {"joint": JointOptions(), "max_likelihood": MaxLikelihoodOptions()}
RULES = list(OWN_GROUP)


@pytest.mark.parametrize("update", RULES)
def test_a_rule_reads_its_own_settings_and_none_of_the_others(update: str) -> None:
    (other,) = set(RULES) - {update}
    usual = tracks_of({"update": update})
    assert equal(usual, tracks_of({"update": update, other: all_different(OWN_GROUP[other])}))
    assert not equal(usual, tracks_of({"update": update, update: all_different(OWN_GROUP[update])}))


@pytest.mark.parametrize("update", RULES)
def test_when_a_component_counts_as_hidden_is_one_setting_for_both_rules(update: str) -> None:
    gated: dict[str, object] = {"update": update, "max_likelihood": {"association": {"gate_std": 3.0}}}
    soon, late = (tracks_of(gated | {"reporting": {"hidden_after_s": s}}) for s in (0.25, 5.0))
    assert any((tracks.state == HIDDEN).any() for tracks in soon)
    assert not any((tracks.state == HIDDEN).any() for tracks in late)


@pytest.mark.parametrize("update", RULES)
def test_which_hidden_components_are_reported_is_one_setting_for_both_rules(update: str) -> None:
    usual = tracks_of({"update": update})
    strict = tracks_of({"update": update, "reporting": {"reported_std_lon_m": 1e-3}})
    assert any((tracks.std_lon_m[tracks.state == HIDDEN] > 1e-3).any() for tracks in usual)
    assert not any((tracks.std_lon_m[tracks.state == HIDDEN] > 1e-3).any() for tracks in strict)


def tracks_of(options: dict[str, object]) -> list[Tracks]:
    """Track a car in plain view and one that a third one comes to hide, with clutter, beside an ego at 20 m/s."""
    settings = FilterOptions.model_validate({"particles": 100, **options})
    tracker = MixtureTracker(ROAD, SensorModel(), motion_model("cvm"), np.random.default_rng(0), settings)
    rng = np.random.default_rng(1)
    tracks = []
    for step in range(45):
        seen = [(15.0, lane_centre(3)), (14.0 if step >= 15 else 50.0, lane_centre(2))]
        if not 15 <= step < 30:
            seen.append((40.0, lane_centre(2)))
        seen.append((rng.uniform(-60.0, 60.0), rng.uniform(0.0, 18.0)))
        moved = [(lon + 2.0 * step + rng.normal(0.0, 0.3), lat + rng.normal(0.0, 0.2)) for lon, lat in seen]
        tracks.append(tracker.step(scan_of(0.1 * step, moved, ego_at(lon_m=2.0 * step))))
    return tracks


def all_different(group: Settings) -> dict[str, object]:
    return {name: different(value) for name, value in group.model_dump().items()}


def different(value: object) -> object:
    if isinstance(value, dict):
        return {name: different(inner) for name, inner in value.items()}
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return "charitable"
    if isinstance(value, int):
        return 2 * value + 1
    if isinstance(value, tuple):
        return tuple(different(inner) for inner in value[:-1]) + value[-1:]
    assert isinstance(value, float)
    return 3.0 if math.isinf(value) else 0.5 * value if value else 0.25


def equal(first: list[Tracks], second: list[Tracks]) -> bool:
    """Return whether all arrays of all tracks are the same to the last bit."""
    return all(
        getattr(a, column.name).tobytes() == getattr(b, column.name).tobytes()
        for a, b in zip(first, second, strict=True)
        for column in fields(Tracks)
    )
