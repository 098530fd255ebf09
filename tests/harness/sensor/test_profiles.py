from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.config.sensor import SensorSettings
from harness.sensor.profiles import sensor_profiles, sensor_settings

PAGE = Path(__file__).parents[3] / "docs" / "explanation" / "sensor.md"


def test_the_profiles_exist_and_explain_their_figures():
    assert list(sensor_profiles) == [
        *("av2-points", "camera", "ideal", "kitti-pointrcnn", "lidar", "lidar-independent", "lidar-real", "radar")
    ]
    assert all(len(sensor_profiles[name].__doc__ or "") > 200 for name in sensor_profiles)


@pytest.mark.parametrize("field", sorted(SensorSettings.model_fields))
def test_every_field_of_every_profile_can_be_replaced(field):
    for profile in sensor_profiles:
        old = getattr(sensor_settings(profile, {}), field)
        new = 0.2 if old is None else old * 0.9
        if field in {"hidden_noise_factor", "full_view_fraction", "nominal_full_view_fraction"}:
            new = old + 1 if field == "hidden_noise_factor" else 0.9
        assert getattr(sensor_settings(profile, {field: new}), field) == pytest.approx(new)


def test_a_number_given_as_text_counts_as_a_number():
    assert sensor_settings("lidar", {"range_m": "80"}).range_m == 80.0


@pytest.mark.parametrize(
    ("profile", "overrides", "named"),
    [
        ("sonar", {}, "av2-points, camera, ideal, kitti-pointrcnn, lidar, lidar-independent, lidar-real, radar"),
        ("lidar", {"reach": 3}, "sensor.reach"),
        ("lidar", {"range_m": -1}, "sensor.range_m"),
        ("lidar", {"range_m": np.nan}, "sensor.range_m"),
        ("lidar", {"range_m": "far"}, "sensor.range_m"),
        ("lidar", {"detection_probability": 1.2}, "sensor.detection_probability"),
        ("lidar", {"detection_probability": np.nan}, "sensor.detection_probability"),
        ("lidar", {"hidden_fraction": 0.9}, "hidden_fraction must be below full_view_fraction"),
        ("lidar", {"nominal_hidden_fraction": 0.9}, "nominal_hidden_fraction must be below"),
        ("lidar", {"burst_share": 0.95}, "sensor.burst_share"),
        ("lidar", {"missed_run_s": 0.0}, "sensor.missed_run_s"),
        ("lidar", {"latency_s": -0.1}, "sensor.latency_s"),
        ("lidar", {"detectability_share": 0.1, "detectability_least": 0.7}, "detectability_mean must lie between"),
    ],
)
def test_a_wrong_sensor_setting_is_refused_on_one_line_that_names_it(profile, overrides, named):
    with pytest.raises(InputError) as refusal:
        sensor_settings(profile, overrides)
    assert named in str(refusal.value)


def test_the_page_on_the_sensor_tells_the_rates_that_the_profiles_have():
    lines = [line.strip("|").split("|") for line in PAGE.read_text(encoding="utf-8").splitlines() if "`" in line]
    header = next(cells for cells in lines if cells[0].strip() == "failure")
    profiles = [sensor_settings(cell.strip(" `"), {}) for cell in header[2:]]
    rows = [cells for cells in lines if len(cells) == len(header) and cells is not header]
    assert len(rows) >= 10
    for _, names, *told in rows:
        settings = [name.strip(" `") for name in names.split(",")]
        for sensor, cell in zip(profiles, told, strict=True):
            if cell.strip() != "-":
                assert [float(value) for value in cell.split(",")] == [getattr(sensor, name) for name in settings]
