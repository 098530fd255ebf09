"""Wrong input of every kind is one line that names it: calls from Python, options, settings and spoilt files."""

from __future__ import annotations

import pytest

import harness
from harness.commands.app import run_command_line
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.truth.network.test_hostile_networks import own
from tests.harness.truth.recorded import layouts

NO_TEXT = "\ud800"
CALLS = [
    *(("stress", {"seeds": seeds}) for seeds in ([0.5], ["a"], [None], [1e300], [[1]], b"1", [True])),
    *(("stress", {"densities": densities}) for densities in ([None], [float("nan")], [[1]], b"2", object())),
    *(("open_run", {"folder": folder}) for folder in (None, 3, b"x", [], NO_TEXT, "a\0b", "x" * 5000)),
    *(("compare", {"a": side, "b": "x"}) for side in (None, 3, b"x", [], NO_TEXT)),
    *(("compare", {"tolerance": value}) for value in ("a", -1.0, float("nan"), True, 5.0)),
    *(("compare", {"primary": value}) for value in ([], 3, [3])),
    ("compare", {"allow_different": "x"}),
    *(("run", {name: NO_TEXT}) for name in ("net", "out", "config", "replay", "tracker", "model", "sensor")),
    *(("run", {"settings": value}) for value in ({"a": object()}, {NO_TEXT: 1}, [3], "a=1")),
    *(("run", {"tracker": name}) for name in (":", "mmpf:", "a:b:c", 3)),
    *(("run", {"seed": value}) for value in (1.0, True)),
]


@pytest.mark.parametrize(("name", "options"), CALLS, ids=[f"{name}-{number}" for number, (name, _) in enumerate(CALLS)])
def test_every_wrong_argument_raises_the_documented_error(name, options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = write_recorded_scene(tmp_path / "scene")
    rest = {"compare": {"a": scene, "b": scene}, "stress": {"densities": [20.0], "out": "grid"}}.get(name, {})
    with pytest.raises(harness.InputError) as told:
        getattr(harness, name)(**{**rest, **options})
    assert "\n" not in str(told.value)


RECORDED = [f"traffic.recording.{word}" for word in ("map=true", "format=9")]


@pytest.mark.parametrize("setting", RECORDED)
def test_a_setting_that_no_run_has_is_one_short_line(setting, tmp_path, capfd):
    fcd = ["--replay", str(layouts.write_fcd(tmp_path / "fcd.xml"))]
    out = ["--out", str(tmp_path / "out"), "--duration", "1", "--quiet"]
    assert run_command_line(["run", *fcd, "--set", setting, *out]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert len(line) < 1500


COMMANDS = [["run", "--tracker", "mmpf:"], ["run", "--sensor", "os:abort"]]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_options_that_contradict_or_lead_nowhere_are_one_line(words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert run_command_line(words) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


def test_nothing_is_left_of_what_was_refused(tmp_path):
    path = own(tmp_path, net="<net>" + "x" * 10)
    before = sorted(tmp_path.iterdir())
    run_command_line(["run", "--net", path, "--duration", "1", "--out", str(tmp_path / "out")])
    assert sorted(tmp_path.iterdir()) == before
