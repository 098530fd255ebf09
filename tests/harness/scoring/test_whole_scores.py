"""All scores and tables of two lively runs: numbers that other tests' plain loops and rules agree with, kept whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.decisions.decide import driver_of
from harness.scoring.driving.asked import DriverSetup
from harness.scoring.score import RunScorer, ScoredRun, score_run
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import Lane
from tests.harness.scoring.metrics.test_decisions import LEFT, Drive
from tests.harness.scoring.scenes import STEP_S, traffic
from tests.harness.scoring.test_plane import leaves

KNOWN = Path(__file__).parent / "golden"
STEPS = 120
LANES = CorridorRoad(lanes=tuple(Lane(number=k + 1, right_m=3.6 * k - 1.8, left_m=3.6 * k + 1.8) for k in range(5)))


def equals_file(text: str, path: Path) -> None:
    assert text == path.read_text(encoding="utf-8"), path.name


def holds_file(numbers: Mapping[str, object], path: Path) -> None:
    """Compare numbers by their names with a file that has a line for each; names that it lacks are let pass.

    Numbers may differ by a millionth, since processors round differently.
    """
    for line in path.read_text(encoding="utf-8").splitlines():
        name, value = line.split(" ", 1)
        found = numbers.get(name)
        close = pytest.approx(float(value), rel=1e-6, abs=1e-9, nan_ok=True) if isinstance(found, float) else value
        assert (found if isinstance(found, float) else str(found)) == close, f"{path.name}: {name}"


def expected_vehicles(steps: int) -> pd.DataFrame:
    """Return what somebody expects on three stretches of lane twice a second."""
    rows = [
        {"step": step, "time_s": STEP_S * step, "episode": 0, "stretch": place, "from_lon_m": 30.0 * place + step,
         "from_lat_m": 3.6, "to_lon_m": 30.0 * place + 25.0 + step, "to_lat_m": 3.6,
         "expected": (0.004, 0.07, 0.5)[place] * (1 + 0.01 * step)}
        for step in range(0, steps, 5) for place in range(3)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def motorway() -> tuple[pd.DataFrame, ...]:
    """Return a jam with a fast ego among noisy tracks, of which some say little of their existence or no speed."""
    truth, detections, tracks = traffic(steps=STEPS, vehicles=24, seed=5)
    number = truth["vehicle_id"].str.removeprefix("car").astype(int)
    truth = truth.assign(
        speed_mps=truth["speed_mps"] + 6.0 * truth["is_ego"], length_m=4.0 + 0.1 * number,
        window_start_m=5.0 + 10.0 * truth["time_s"], window_end_m=95.0 + 10.0 * truth["time_s"],
        parked=number % 7 == 3,
    )  # fmt: skip
    place = np.arange(len(detections))
    detections = detections.assign(
        length_m=np.where(place % 3 == 0, np.nan, 4.2 + 0.02 * (place % 50)), width_m=1.7 + 0.01 * (place % 20)
    )
    tracks = tracks[(tracks["track_id"] % 24 != 5) | (tracks["step"] % 40 < 18)]
    which = np.arange(len(tracks))
    return truth, detections, tracks.assign(
        existence=np.where(which % 6 == 0, 0.3, 0.9), speed_mps=tracks["speed_mps"].where(which % 11 != 0),
        std_lon_m=np.where(which % 13 == 0, np.nan, 0.8), state=tracks["state"].where(which % 17 != 0, "tentative"),
    )  # fmt: skip


def town() -> tuple[pd.DataFrame, ...]:
    """Return traffic in the plane that bends to the left and right, comes towards the ego, and hides behind walls."""
    truth, detections, tracks = traffic(steps=STEPS, vehicles=24, seed=6)
    number = truth["vehicle_id"].str.removeprefix("car").astype(int).to_numpy()
    begin = np.array([0.0, 0.3, np.pi, -0.4, 0.5 * np.pi])[number % 5]
    rate = np.array([0.0, 0.3, 0.0, -0.35, 0.25])[number % 5]
    direction = begin + rate * truth["time_s"].to_numpy()
    truth = truth.assign(
        direction_rad=np.remainder(direction + np.pi, 2 * np.pi) - np.pi,
        wall_fraction=np.where(number % 2 == 0, 0.6, 0.1) * (1.0 - truth["visible_fraction"]),
        on_roundabout=(number % 8 == 1) & (truth["step"] > 60), pedestrian=number == 23,
    )  # fmt: skip
    return truth, detections, tracks.assign(std_lon_m=0.7, std_lat_m=0.7)


def drive() -> ScoredRun:
    """Return a drive behind a car that slows down twice, its track lost and then late, past a ghost and a neighbour."""
    step = np.arange(80)
    slow = np.where(((step >= 30) & (step < 38)) | ((step >= 58) & (step < 70)), 8.0, 20.0)
    scene = Drive().car("slow", 24.0, slow, state=np.where((step > 26) & (step < 45), "hidden", "visible"),
                        detected=(step <= 26) | (step >= 45))  # fmt: skip
    scene.car("beside", -3.0, np.where(step < 60, 19.0, 26.0), lat=LEFT).car("late", 60.0, 18.0, at=step[40:])
    scene.track(1, 24.0, slow[:24], at=step[:24]).track(2, 26.0, slow[63:], at=step[63:], existence=0.8)
    scene.track(3, 14.0, 9.0, at=step[44:52], existence=0.6).track(4, 10.0, 3.0, at=step[72:], existence=0.4)
    scene.track(5, -3.0, 19.0, lat=LEFT, at=step[step % 20 < 14])
    # The neighbour's track comes into the ego's lane.
    scene.track(6, np.where(step > 52, 15.0, 60.0)[40:58], 10.0, at=step[40:58])
    return scene.scored("mobil")


def second(tables: tuple[pd.DataFrame, ...]) -> list[tuple[pd.DataFrame, ...]]:
    """Return a run's tables as those of two episodes, cut in the middle."""
    parts = []
    for episode, (low, high) in enumerate(((0, STEPS // 2), (STEPS // 2, STEPS))):
        truth, *others = (table[(table["step"] >= low) & (table["step"] < high)] for table in tables)
        parts.append((truth.assign(episode=episode), *others))
    return parts


@pytest.fixture(scope="module")
def scored() -> dict[str, ScoredRun]:
    return {
        "motorway": score_run(
            *motorway(), seed=3, driven=DriverSetup(driver_of("mobil"), LANES), unseen=expected_vehicles(STEPS)
        ),
        "town": score_run(*town(), seed=3),
        "drive": drive(),
    }


@pytest.mark.parametrize("name", ["motorway", "town", "drive"])
def test_every_score_of_a_run(scored, name):
    holds_file(dict(leaves(scored[name].metrics)), KNOWN / f"{name}.txt")


def as_text(table: pd.DataFrame) -> str:
    return table.round(4).to_csv(index=False, float_format="%.6g")


@pytest.mark.parametrize("name", ["motorway", "town"])
def test_every_occlusion_of_a_run(scored, name):
    equals_file(as_text(scored[name].events), KNOWN / f"{name}-events.csv")


def test_every_missed_and_phantom_braking_of_a_drive(scored):
    equals_file(as_text(scored["drive"].brakings), KNOWN / "drive-brakings.csv")
    assert set(scored["drive"].brakings["kind"]) == {"missed", "phantom"}


@pytest.mark.parametrize(("name", "every"), [("motorway", 10), ("drive", 3)])
def test_what_the_driver_would_do_in_a_run(scored, name, every):
    equals_file(as_text(scored[name].commands.iloc[::every]), KNOWN / f"{name}-commands.csv")


@pytest.mark.parametrize("name", ["motorway", "town"])
def test_the_errors_of_a_run(scored, name):
    errors = scored[name].errors
    told = {f"column.{column}": str(errors[column].dtype) for column in errors}
    for column in errors.select_dtypes("number"):
        told |= {f"{column}.sum": float(errors[column].sum()), f"{column}.n": int(errors[column].count())}
        told[f"{column}.last"] = float(errors[column].iloc[-1])
    for column in ("state", "outcome", "matched_by", "vehicle_id"):
        counts = errors[column].astype(str).value_counts().sort_index()
        told |= {f"{column}.{value or 'none'}": int(count) for value, count in counts.items()}
    holds_file(told, KNOWN / f"{name}-errors.txt")


def in_one_piece(parts: list[tuple[pd.DataFrame, ...]]) -> tuple[pd.DataFrame, ...]:
    return tuple(pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True))


def equal_scores(found: dict[str, object], wanted: dict[str, object]) -> None:
    """Compare all scores; intervals draw the vehicles in the order in which they came, so that they differ a little."""
    found, wanted = (dict(leaves(metrics)) for metrics in (found, wanted))
    assert set(found) == set(wanted)
    for name, value in wanted.items():
        if isinstance(value, str):
            assert found[name] == value, name
            continue
        assert found[name] == pytest.approx(value, rel=0.05 if "_ci95" in name else 1e-9, nan_ok=True), name


def test_a_run_that_came_in_two_stretches_has_the_scores_of_the_run_in_one_piece():
    driven, unseen = DriverSetup(driver_of("hdm"), LANES), expected_vehicles(STEPS)
    unseen = unseen.assign(episode=(unseen["step"] >= STEPS // 2).astype(int))
    scorer = RunScorer(3, driven)
    for episode, tables in enumerate(second(motorway())):
        scorer.add(*tables, unseen[unseen["episode"] == episode])
    whole = score_run(*in_one_piece(second(motorway())), seed=3, driven=driven, unseen=unseen)
    equal_scores(scorer.metrics(), whole.metrics)
    town_scorer = RunScorer(3)
    for tables in second(town()):
        town_scorer.add(*tables)
    whole = score_run(*in_one_piece(second(town())), seed=3)
    equal_scores(town_scorer.metrics(), whole.metrics)
