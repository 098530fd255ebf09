"""A tracker run with the truth replaced by noise gives the very same tracks: it never sees the truth."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage import run_folder as runfolder
from harness.storage.schema import VISIBILITY_STATES
from harness.storage.tables import write_table
from tests.harness.stand_ins import SteadyTraffic, observing

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Record 1.8 s of traffic on three lanes, in which cars hide each other, under two egos."""
    config = resolve_run_config(options={"tracker": "tests.harness.stand_ins:echo_tracker", "seed": 4})
    out = tmp_path_factory.mktemp("separation") / "recording"
    return run(config, out=out, open_snapshots=observing(SteadyTraffic(steps=18, ego_stay=10))).folder


@pytest.fixture(scope="module")
def scrambled(recording: Path) -> Path:
    """Copy the recording and replace by noise all that no tracker may see."""
    folder = recording.with_name("scrambled")
    shutil.copytree(recording, folder)
    rng = np.random.default_rng(99)
    truth = pd.read_parquet(folder / runfolder.TRUTH)
    detections = pd.read_parquet(folder / runfolder.DETECTIONS)
    write_table(_noisy_truth(truth, rng), folder / runfolder.TRUTH)
    write_table(_noisy_detections(detections, truth, rng), folder / runfolder.DETECTIONS)
    return folder


@pytest.mark.parametrize(
    ("tracker", "options"),
    [
        pytest.param("mmpf", {"model": "gmm", "particles": 200}, marks=pytest.mark.slow),
        ("mmpf", {"model": "cvm", "particles": 200}),
        pytest.param("mmpf", {"model": "gmm", "particles": 200, "update": "max_likelihood"}, marks=pytest.mark.slow),
        pytest.param("stonesoup-gnn", {}, marks=pytest.mark.slow),
    ],
    ids=["mmpf gmm", "mmpf cvm", "mmpf gmm max_likelihood", "stonesoup-gnn"],
)
def test_noise_in_place_of_truth_changes_no_track(recording, scrambled, tracker, options):
    if tracker.startswith("stonesoup"):
        pytest.importorskip("stonesoup")
    seen, unseen = (tracks_of(folder, tracker, options) for folder in (recording, scrambled))
    assert len(pd.read_parquet(seen)) > 100
    assert seen.read_bytes() == unseen.read_bytes()


@pytest.mark.parametrize(
    ("tracker", "options", "minds_sizes"),
    [
        ("mmpf", {"model": "cvm", "particles": 200}, True),
        pytest.param("stonesoup-gnn", {}, False, marks=pytest.mark.slow),
    ],
    ids=["mmpf", "stonesoup-gnn"],
)
def test_measured_sizes_reach_the_tracker_which_may_ignore_them(recording, tracker, options, minds_sizes, tmp_path):
    if tracker.startswith("stonesoup"):
        pytest.importorskip("stonesoup")
    folder = shutil.copytree(recording, tmp_path / "resized")
    detections = pd.read_parquet(folder / runfolder.DETECTIONS)
    assert (detections["length_m"].to_numpy() != 4.5).all(), "the true lengths must not be among the detections"
    rng = np.random.default_rng(98)
    write_table(detections.assign(length_m=rng.uniform(3.0, 18.0, len(detections))), folder / runfolder.DETECTIONS)
    seen, resized = (tracks_of(one, tracker, options) for one in (recording, folder))
    assert (seen.read_bytes() != resized.read_bytes()) == minds_sizes


def test_the_bound_that_is_told_the_truth_is_found_out(recording, scrambled):
    seen, unseen = (tracks_of(folder, "oracle-kalman", {}) for folder in (recording, scrambled))
    assert seen.read_bytes() != unseen.read_bytes()


def tracks_of(folder: Path, tracker: str, options: dict) -> Path:
    """Replay a folder, unless that was done before, and return the file of its tracks."""
    config = resolve_run_config(options={"replay": str(folder), "tracker": tracker, **options})
    out = folder.with_name(f"{folder.name} again {tracker} {'-'.join(map(str, options.values()))}")
    return (out if out.exists() else run(config, out=out).folder) / runfolder.TRACKS


def _noisy_truth(truth: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Return the truth with noise in all rows but the ego's, which its own vehicle knows; one new name per vehicle."""
    noisy = truth.copy()
    others = ~truth["is_ego"].to_numpy()
    names = truth["vehicle_id"].unique()
    renamed = dict(zip(names, rng.permutation(names), strict=True))
    ego_names = {step: rows["vehicle_id"].iloc[0] for step, rows in truth[~others].groupby("step")}
    noisy["vehicle_id"] = [
        _noise_name(renamed[name], ego_names[step]) if other else name
        for name, step, other in zip(truth["vehicle_id"], truth["step"], others, strict=True)
    ]
    count = int(others.sum())
    for column in ("lon_m", "lat_m", "speed_mps", "lat_speed_mps", "accel_mps2"):
        noisy.loc[others, column] = rng.uniform(0.0, 30.0, count)
    noisy.loc[others, "heading_rad"] = rng.uniform(-np.pi, np.pi, count)
    noisy.loc[others, "lane"] = rng.integers(1, 4, count)
    noisy.loc[others, ["length_m", "width_m"]] = rng.uniform(1.0, 9.0, (count, 2))
    noisy.loc[others, "visible_fraction"] = rng.uniform(size=count)
    noisy.loc[others, "in_range"] = rng.random(count) < 0.5
    noisy.loc[others, "state"] = rng.choice(np.array(VISIBILITY_STATES, dtype=object), count)
    noisy["occluder_id"] = ""
    return noisy


def _noise_name(name: str, ego: str) -> str:
    return f"{name} again" if name == ego else name


def _noisy_detections(detections: pd.DataFrame, truth: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    names = np.append(truth["vehicle_id"].unique(), "").astype(object)
    return detections.assign(
        truth_id=rng.choice(names, len(detections)), visible_fraction=rng.uniform(size=len(detections))
    )
