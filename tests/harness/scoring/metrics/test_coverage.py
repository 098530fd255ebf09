import numpy as np
import pytest

from tests.harness.scoring.scenes import Scene, score_run

STEPS = np.arange(40)


@pytest.mark.parametrize(("first_tracked", "percent"), [(16, 100.0), (17, 0.0)])
def test_a_track_is_prompt_up_to_half_a_second_after_its_vehicle_became_visible(first_tracked, percent):
    scene = Scene(40).vehicle("a", lon=20.0, state=np.where(STEPS < 11, "hidden", "visible"), detected=STEPS >= 11)
    coverage = score_run(*scene.track(7, lon=20.0, at=STEPS[first_tracked:]).tables()).metrics["coverage"]
    assert coverage["prompt_vehicles"] == 1
    assert coverage["prompt_percent"] == percent


def test_a_vehicle_that_leaves_before_half_a_second_is_up_is_not_judged():
    scene = Scene(40).vehicle("a", lon=20.0, state=np.where(STEPS < 36, "hidden", "visible"), detected=STEPS >= 36)
    assert score_run(*scene.tables()).metrics["coverage"]["prompt_vehicles"] == 0


def test_vehicles_are_counted_by_whether_they_were_ever_in_range_and_ever_detected():
    scene = Scene(40).vehicle("a", lon=20.0, detected=STEPS == 3).vehicle("b", lon=40.0, state="hidden")
    coverage = score_run(*scene.vehicle("c", lon=200.0, state="out").tables()).metrics["coverage"]
    assert (coverage["vehicles_in_range"], coverage["detected"], coverage["never_detected"]) == (2, 1, 1)
    assert coverage["hidden_percent"] == pytest.approx(50.0)
