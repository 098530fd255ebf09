"""Wrong input of every kind is one line that names it: calls from Python, options, settings and spoilt files."""

from __future__ import annotations

import json

import pandas as pd
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


SETTINGS = [
    *("sensor.range_m=1e300", "sensor.std_lon_m=1e-300", "sensor.std_lon_m=1e150", "sensor.std_range_share=1e9"),
    *("sensor.std_bearing_deg=1e9", "sensor.missed_run_s=1e-300", "sensor.range_m=80\nseed=5"),
    *("tracker.believes.range_m=1e-300", "tracker.believes.noise_factor=1e-300"),
    *("tracker.believes.detection_probability=0", "tracker.options.joint.association.gate_std=1e308", "seed=1e3"),
    "x" * 100_000 + "=1",
]
RECORDED = [f"traffic.recording.{word}" for word in ("start_s=1e308", "least_score=0.5", "map=true", "format=9")]


@pytest.mark.parametrize("setting", [*SETTINGS, *RECORDED], ids=lambda text: text[:60])
def test_a_setting_that_no_run_has_is_one_short_line(setting, tmp_path, capfd):
    fcd = ["--replay", str(layouts.write_fcd(tmp_path / "fcd.xml"))] if setting in RECORDED else []
    out = ["--out", str(tmp_path / "out"), "--duration", "1", "--quiet"]
    assert run_command_line(["run", *fcd, "--set", setting, *out]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert len(line) < 1500


COMMANDS = [
    ["drive", "--provoke", "cross", "--net", "us101"],
    ["study", "lane-keeping", "--models", ",,"],
    ["train", "--net", "junction", "--case", "lane-keeping"],
    ["stress", "--vary", "sensor.range_m=80", "--set", "sensor.range_m=40"],
    ["run", "--tracker", "mmpf:"],
    ["run", "--sensor", "os:abort"],
]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_options_that_contradict_or_lead_nowhere_are_one_line(words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert run_command_line(words) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("option", ["markdown", "html"])
def test_a_comparison_replaces_no_file_that_it_did_not_write(option, tmp_path, capfd):
    scene, file = write_recorded_scene(tmp_path / "scene"), tmp_path / "precious.py"
    words = ["compare", str(scene), str(scene), f"--{option}", str(file), "--quiet", "--allow-undecided"]
    assert run_command_line(words) == 0
    assert run_command_line(words) == 0, "its own file may be replaced"
    file.write_text("precious")
    assert run_command_line(words) == 2
    assert f"--{option}" in capfd.readouterr().err
    assert file.read_text() == "precious"
    assert run_command_line([*words, "--force"]) == 0
    assert file.read_text() != "precious"


def test_results_that_are_nested_too_deeply_are_one_line(tmp_path, capfd):
    scene = write_recorded_scene(tmp_path / "scene")
    (scene / "metrics.json").write_text("[" * 100_000)
    for words in (["compare", str(scene), str(scene)], ["report", str(scene)]):
        assert run_command_line(words) == 2
        assert len(capfd.readouterr().err.splitlines()) == 1


SPOILT_NETS = {
    "fine lateral resolution": {"options": '<lateral-resolution value="1e-9"/>'},
    "hexadecimal resolution": {"options": '<lateral-resolution value="0x1p-30"/>'},
    "braking that is not a number": {"options": '<default.emergencydecel value="nan"/>'},
    "a polygon without colour": {"additional": '<a><poly id="p" type="building" shape="0,0 1,0 1,1"/></a>'},
}


@pytest.mark.parametrize("name", SPOILT_NETS)
def test_a_network_that_makes_no_sense_is_one_line(name, tmp_path, capfd):
    path = own(tmp_path, **SPOILT_NETS[name])
    assert run_command_line(["run", "--net", path, "--duration", "1", "--out", str(tmp_path / "out")]) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


def edited(name, change):
    """Return a way to change a table of a run and to hide it from the manifest."""

    def spoil(scene):
        table = change(pd.read_parquet(scene / name))
        table.to_parquet(scene / name)
        manifest = json.loads((scene / "manifest.json").read_text())
        manifest["rows"][name] = len(table)
        (scene / "manifest.json").write_text(json.dumps(manifest))

    return spoil


SPOILT_RUNS = {
    "a lane that is not there": edited("truth.parquet", lambda table: table.assign(lane=99)),
    "more than all is visible": edited("truth.parquet", lambda table: table.assign(visible_fraction=5.0)),
    "every second step": edited("truth.parquet", lambda table: table[table["step"] % 2 == 0]),
}


@pytest.mark.parametrize("words", [["run", "--quiet", "--tracker", "detections", "--replay"], ["report"]], ids=str)
@pytest.mark.parametrize("name", SPOILT_RUNS)
def test_a_run_that_was_changed_is_one_line(name, words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    scene = write_recorded_scene(tmp_path / "scene")
    SPOILT_RUNS[name](scene)
    assert run_command_line([*words, str(scene)]) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


def ngsim(**changes):
    """Return a way to change columns of NGSIM's table; a text replaces each cell."""

    def spoil(path):
        table = pd.read_csv(path, dtype=str)
        table = table.assign(**changes)
        table.to_csv(path, index=False)

    return spoil


NGSIM = {
    "another site": ngsim(Location="i-80"),
    "no speed": ngsim(v_Vel=""),
    "half a vehicle": ngsim(Vehicle_ID="7.5"),
}


@pytest.mark.parametrize("name", NGSIM)
def test_an_ngsim_table_that_makes_no_sense_is_one_line(name, tmp_path, capfd):
    path = layouts.write_ngsim_csv(tmp_path / "a.csv")
    NGSIM[name](path)
    assert run_command_line(["run", "--replay", str(path), "--quiet", "--out", str(tmp_path / "out")]) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


def test_a_last_line_that_was_cut_is_one_line(tmp_path, capfd):
    path = layouts.write_ngsim_text(tmp_path / "a.txt")
    path.write_text(" ".join(path.read_text().split(" ")[:-4]))
    assert run_command_line(["run", "--replay", str(path), "--quiet", "--out", str(tmp_path / "out")]) == 2
    assert "cut off" in capfd.readouterr().err


TWICE = {"lanelet": ("<lanelet ", "</lanelet>"), "obstacle": ("<dynamicObstacle ", "</dynamicObstacle>")}


@pytest.mark.parametrize("what", TWICE)
def test_what_commonroad_has_twice_is_one_line(what, tmp_path, capfd):
    path = layouts.write_commonroad(tmp_path / "a.xml")
    text, (begin, end) = path.read_text(), TWICE[what]
    element = text[text.index(begin) : text.index(end) + len(end)]
    path.write_text(text.replace(element, element * 2, 1))
    assert run_command_line(["run", "--replay", str(path), "--quiet", "--out", str(tmp_path / "out")]) == 2
    assert f"{what} " in capfd.readouterr().err


def test_nothing_is_left_of_what_was_refused(tmp_path):
    path = own(tmp_path, net="<net>" + "x" * 10)
    before = sorted(tmp_path.iterdir())
    run_command_line(["run", "--net", path, "--duration", "1", "--out", str(tmp_path / "out")])
    assert sorted(tmp_path.iterdir()) == before
