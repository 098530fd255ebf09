"""The list of settings: complete, explained, with the defaults that a run takes, in units that one can hold."""

import json
import tomllib
from typing import get_args

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from harness.commands.app import run_command_line
from harness.commands.settings_table import Setting, all_settings
from harness.common.errors import InputError
from harness.config.model import RunConfig
from harness.config.sensor import SensorSettings
from harness.running.resolve import resolve_run_config
from harness.sensor.profiles import sensor_profiles, sensor_settings
from harness.trackers.catalogue import TUNED_FILE, available_trackers, tracker_options
from mmpf.motion.protocol import motion_models
from mmpf.options.base import fields_of, unit_of
from mmpf.options.filter import FilterOptions

CLASSES = [RunConfig, SensorSettings, *(tracker_options(name) for name in available_trackers())]
PURE_NUMBERS = (
    "persistent_clutter", "_share", "_fraction", "_factor", "_probability", "_log_odds", "_scans", "_separation",
)  # fmt: skip


def by_key(word: str, kind: str) -> dict[str, Setting]:
    return {row.key: row for row in all_settings(word) if row.kind == kind}


def is_plainly_without_unit(key: str, field: FieldInfo) -> bool:
    """A word, a count, a switch, a number from 0 to 1, or one whose name says that it is a ratio."""
    if float not in (field.annotation, *get_args(field.annotation)) and "float" not in str(field.annotation):
        return True
    least, most = (
        {getattr(bound, name, None) for bound in field.metadata for name in names}
        for names in (("ge", "gt"), ("le", "lt"))
    )
    return (0.0 in least and 1.0 in most) or key.endswith(PURE_NUMBERS)


@pytest.mark.parametrize("settings", CLASSES, ids=lambda settings: settings.__name__)
def test_every_setting_says_what_it_means_and_in_which_unit(settings: type[BaseModel]) -> None:
    for key, field in fields_of(settings):
        assert field.description, key
        assert unit_of(key, field) or is_plainly_without_unit(key, field), f"{key} has no unit"


def test_no_group_of_the_filters_settings_is_too_large_to_hold() -> None:
    groups: dict[str, int] = {}
    for key, _ in fields_of(FilterOptions):
        group = key.rpartition(".")[0]
        groups[group] = groups.get(group, 0) + 1
    assert max(groups.values()) <= 8
    assert groups["joint.association"] > 1


def test_every_network_profile_tracker_and_model_is_listed_by_name() -> None:
    keys = {row.key for row in all_settings()}
    for key, names in (
        ("traffic.net", ["us101"]),
        ("sensor.profile", sensor_profiles),
        ("tracker.name", available_trackers()),
        ("tracker.model", motion_models),
    ):
        assert {f"{key}={name}" for name in names} <= keys


def test_a_sensors_defaults_are_its_profiles_and_of_the_others_the_differences_are_listed() -> None:
    for profile in ("radar", "camera"):
        usual = {row.key: row.default for row in by_key("sensor.", "sensor lidar").values()}
        listed = usual | {row.key: row.default for row in by_key("sensor.", f"sensor {profile}").values()}
        actual = sensor_settings(profile, {})
        assert listed == {f"sensor.{name}": value for name, value in actual.model_dump().items()}


def test_a_tuned_trackers_defaults_are_the_tuned_ones() -> None:
    tuned = tomllib.loads(TUNED_FILE.read_text())["stonesoup-gnn"]["options"]
    listed = by_key("tracker.options", "tracker stonesoup-gnn")
    assert {name: listed[f"tracker.options.{name}"].default for name in tuned} == tuned


def test_setting_each_key_to_its_default_changes_nothing() -> None:
    usual = resolve_run_config(settings=[])
    words = [f"{row.key}={json.dumps(row.default)}" for row in all_settings() if row.kind == "run"]
    words = [word for word in words if not word.endswith("=null") and "recording" not in word]
    assert resolve_run_config(settings=words) == usual
    nested: dict[str, dict[str, object]] = {}
    for row in all_settings("tracker.options"):
        if row.kind == "tracker mmpf" and row.default is not None:
            *groups, name = row.key.removeprefix("tracker.options.").split(".")
            table = nested
            for group in groups:
                table = table.setdefault(group, {})  # type: ignore[assignment]
            table[name] = row.default  # type: ignore[assignment]
    assert FilterOptions.model_validate(nested) == FilterOptions()


def test_a_word_chooses_by_key_or_kind_and_one_that_nothing_has_is_refused() -> None:
    assert all("joint" in row.key for row in all_settings("joint"))
    assert {row.kind for row in all_settings("radar")} == {"sensor radar", "sensor profile"}
    with pytest.raises(InputError, match="nonsense"):
        all_settings("nonsense")


def test_the_command_prints_rows_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["settings", "gate_std", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows[0] == {
        "key": "tracker.options.joint.association.gate_std",
        "default": 4.5,
        "unit": "\u03c3",
        "meaning": "A detection counts for a component within this many standard deviations.",
        "kind": "tracker mmpf",
    }


def test_no_meaning_is_that_of_a_language_s_own_parts():
    assert not [row.key for row in all_settings() if "functools" in row.meaning or "partial application" in row.meaning]
