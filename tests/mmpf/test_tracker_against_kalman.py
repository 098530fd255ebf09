import numpy as np
import pytest
from scipy.stats import t as student

from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import BirthOptions, FilterOptions, ModelErrorOptions
from mmpf.options.joint import JointAssociation, JointManoeuvres, JointNoise, JointOptions, JointResampling
from mmpf.scan import Scan, SensorModel
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, LinearGaussianMotion, detections_at, ego_at

STEPS, PARTICLES, REPLICATES = 50, 2000, 60
DT_S, STD_LON_M, STD_LAT_M, EGO_SPEED_MPS = 0.1, 0.5, 0.3, 20.0
BIRTH = BirthOptions(local_speed_share=1.0, local_speed_std_mps=2.0, lat_speed_std_mps=0.4, standing_share=0.0)
SENSOR = SensorModel(detection_probability=0.999, clutter_per_scan=1e-3)


def recorded_scans() -> list[Scan]:
    rng = np.random.default_rng(7)
    lon, lat, speed = 20.0, 5.0, 21.0
    scans = []
    for step in range(STEPS + 1):
        measured = (lon + STD_LON_M * rng.standard_normal(), lat + STD_LAT_M * rng.standard_normal())
        ego = ego_at(lon_m=EGO_SPEED_MPS * DT_S * step, speed_mps=EGO_SPEED_MPS)
        scans.append(Scan(DT_S * step, detections_at([measured], STD_LON_M, STD_LAT_M), ego))
        lon += DT_S * speed
        speed += 0.2 * rng.standard_normal()
    return scans


def exact_means(scans: list[Scan]) -> FloatArray:
    """Kalman filter over (position, speed) in each direction; returns (steps, 4): lon, speed, lat, lateral speed."""
    transition = np.array([[1.0, DT_S], [0.0, 1.0]])
    first = scans[0].detections
    filters = [
        (np.array([first.lon_m[0], EGO_SPEED_MPS]), np.diag([STD_LON_M**2, 2.0**2]), np.diag([0, 0.2**2]), STD_LON_M),
        (np.array([first.lat_m[0], 0.0]), np.diag([STD_LAT_M**2, 0.4**2]), np.diag([0, 0.02**2]), STD_LAT_M),
    ]
    means = []
    for scan in scans[1:]:
        row: list[float] = []
        measured = (scan.detections.lon_m[0], scan.detections.lat_m[0])
        for k, (mean, covariance, noise, std) in enumerate(filters):
            predicted, spread = transition @ mean, transition @ covariance @ transition.T + noise
            gain = spread[:, 0] / (spread[0, 0] + std**2)
            updated = predicted + gain * (measured[k] - predicted[0])
            filters[k] = (updated, spread - np.outer(gain, spread[0]), noise, std)
            row.extend(updated)
        means.append(row)
    return np.array(means)


@pytest.mark.slow
@pytest.mark.parametrize("update", ["joint", "max_likelihood"])
def test_one_linear_gaussian_target_is_tracked_like_the_exact_kalman_filter(update: str) -> None:
    scans = recorded_scans()
    options = FilterOptions(
        update=update,  # type: ignore[arg-type]
        particles=PARTICLES,
        birth=BIRTH,
        model_error=ModelErrorOptions(speed=0.0, accel=0.0, lat_speed=0.0),
        joint=JointOptions(
            association=JointAssociation(gate_std=20.0),
            manoeuvres=JointManoeuvres(begin_per_s=0.0),
            noise=JointNoise(learned=False),
            resampling=JointResampling(young_s=0.0),
        ),
    )
    runs = np.empty((REPLICATES, STEPS, 4))
    for replicate in range(REPLICATES):
        tracker = MixtureTracker(ROAD, SENSOR, LinearGaussianMotion(), np.random.default_rng(replicate), options)
        tracker.step(scans[0])
        for step, scan in enumerate(scans[1:]):
            tracks = tracker.step(scan)
            assert len(tracks) == 1
            runs[replicate, step] = tracks.lon_m[0], tracks.speed_mps[0], tracks.lat_m[0], tracks.lat_speed_mps[0]
    standard_error = runs.std(axis=0, ddof=1)
    deviation = (runs - exact_means(scans)) / standard_error
    bias = deviation.mean(axis=0) * np.sqrt(REPLICATES)
    assert (np.abs(deviation) < 3.0).mean() > 0.99
    # Chance alone exceeds this once in a thousand tests.
    assert np.abs(bias).max() < student.isf(0.0005 / bias.size, REPLICATES - 1)
