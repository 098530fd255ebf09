import json
from html import escape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import harness
import harness.plugins
import mmpf
from harness.config.model import RunConfig
from harness.config.options import RunOptions, checked, keys_of_options, setting_words
from harness.running.resolve import resolve_run_config
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.stand_ins import EchoTracker, echo_tracker

pytestmark = pytest.mark.usefixtures("no_pictures")


NESTED: dict = {}
NESTED["within"] = NESTED


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> harness.Run:
    folder = tmp_path_factory.mktemp("api")
    scene = write_recorded_scene(folder / "scene")
    return harness.run(replay=scene, seed=3, tracker=echo_tracker, out=folder / "run")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"densty": 20}, "`densty`: run has no such parameter; did you mean `density`"),
        ({"nonsense_at_all": 1}, "`nonsense_at_all`"), ({"density": 70}, "`density`.*65"),
        ({"density": float("nan")}, "`density`"), ({"density": "many"}, "`density`: give a number, not 'many'"),
        ({"density": True}, "`density`: give a number, not True"),
        ({"density": 20, "demand": "us101-0805"}, "`demand` or `density`"), ({"demand": "nosuch"}, "`demand` nosuch"),
        ({"duration": -3.0}, "`duration`"), ({"seed": 1.5}, "`seed`: give a whole number, not 1.5"),
        ({"seed": -1}, "`seed`"), ({"particles": 0}, "`particles`"), ({"net": "nosuch"}, "`net` nosuch"),
        ({"net": 3}, "`net`: give a text or a path, not 3"), ({"net": Path("nosuch.sumocfg")}, "`net` nosuch.sumocfg"),
        ({"sensor": "sonar"}, "`sensor`.*sonar"), ({"tracker": "nosuch"}, "`tracker` nosuch"),
        ({"tracker": 3}, "`tracker`: give a text or a function, not 3"),
        pytest.param({"tracker": "no_such_module:make"}, "no_such_module", marks=pytest.mark.slow),
        ({"model": "nosuch"}, "`model`.*nosuch"),
        ({"update": "nosuch"}, "update"), ({"model_file": "nosuch.npz"}, "nosuch.npz"),
        ({"replay": "nosuch"}, "`replay`: .*nosuch"), ({"format": "ngsim"}, "`format`"), ({"ego": "auto"}, "`ego`"),
        ({"config": "nosuch.toml"}, "`config`: nosuch.toml does not exist"),
        ({"settings": {"sensor.rnge_m": 80}}, "sensor.rnge_m"),
        ({"settings": {"sensor.range_m": object()}}, "`settings`: sensor.range_m"),
        ({"settings": ["nonsense"]}, "`settings`: 'nonsense'"), ({"settings": NESTED}, "`settings`: .*too deeply"),
        ({"settings": 5}, "`settings`: give a list or a dictionary"),
        ({"settings": {"tracker.options.gate": 3}}, "gate"), ({"out": 7}, "`out`: give a path or a text"),
        ({"out": "/dev/null/run"}, "`out`"), ({"out": "."}, "`out`"),
        ({"force": 1}, "`force`: give True or False, not 1"), ({"video": "film.avi"}, "`video`.*mp4"),
    ],
)  # fmt: skip
def test_wrong_input_to_a_run_is_one_sentence_and_leaves_nothing(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(harness.InputError, match=words) as told:
        harness.run(**options)
    assert "--" not in str(told.value)
    assert not list(tmp_path.rglob("*.parquet"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"densitys": 20}, "did you mean `densities`"), ({"densities": [20, "many"]}, "`densities`.*'many'"),
        ({"densities": [3]}, "`densities`"), ({"densities": "5:65"}, "`densities`"), ({"seeds": []}, "`seeds`"),
        ({"seeds": [1, 3]}, "`seeds`: give seeds that follow each other"), ({"seeds": 0}, "`seeds`"),
        ({"seeds": 1.5}, "`seeds`: give"), ({"trackers": []}, "`trackers`"), ({"seeds": range(10**12)}, "`seeds`"),
        ({"seeds": 10**9}, "`seeds` 1000000000: 1000000000 values, at most 100000"),
        ({"trackers": [lambda setting, options: None]}, "`trackers`: worker processes"),
        ({"models": ["gmm", "gmm"]}, "`models`"), ({"vary": {"sensor.range_m": "far"}}, "`vary`"),
        ({"workers": 0}, "`workers` 0 is out of range: give 1 or more"),
        ({"workers": 2, "scheduler": "tcp://nowhere:1"}, "`workers`"), ({"replay": "nosuch.csv"}, "nosuch.csv"),
        ({"timeout_per_run": 0.0}, "`timeout_per_run`"), ({"net": "nosuch"}, "`net` nosuch"),
    ],
)  # fmt: skip
def test_wrong_input_to_a_stress_test_is_one_sentence(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(harness.InputError, match=words):
        harness.stress(**options)


@pytest.mark.parametrize(
    "call",
    [
        lambda: harness.open_run("nosuch"), lambda: harness.compare("nosuch", "neither"),
        lambda: harness.Grid(Path("nosuch")).summary, lambda: harness.Run(Path("nosuch")).about,
    ],
)  # fmt: skip
def test_a_folder_that_is_not_there_is_named(call):
    with pytest.raises(harness.InputError, match="nosuch"):
        call()


def test_every_option_of_the_configuration_names_a_key_that_there_is():
    def keys(model, prefix=""):
        for name, field in model.model_fields.items():
            inner = [kind for kind in (field.annotation, *getattr(field.annotation, "__args__", ())) if kind]
            models = [kind for kind in inner if hasattr(kind, "model_fields")]
            yield from keys(models[0], f"{prefix}{name}.") if models else [f"{prefix}{name}"]

    assert set(keys_of_options().values()) <= set(keys(RunConfig))


def test_numbers_and_paths_of_any_kind_become_plain_ones():
    values = checked(RunOptions, {"seed": np.int64(3), "density": np.float32(20.0), "net": Path("here")}, "run")
    assert values["seed"] == 3
    assert type(values["seed"]) is int
    assert type(values["density"]) is float
    assert values["net"] == "here"


def test_a_dictionary_of_settings_says_what_the_command_line_says():
    told = {
        "sensor.range_m": 80,
        "tracker.options": {"joint": {"gate_std": 4.0}},
        "sensor.word": "b c",
        "sensor.on": True,
    }
    words = ["sensor.range_m=80", "tracker.options.joint.gate_std=4.0", 'sensor.word="b c"', "sensor.on=true"]
    assert resolve_run_config(settings=setting_words(told)) == resolve_run_config(settings=words)


def test_a_run_leaves_its_folder_and_tables(run):
    assert {"episode", "step", "vehicle_id", "is_ego"} <= set(run.truth)
    assert run.tracks["step"].max() == run.truth["step"].max()
    assert len(run.detections)
    assert set(run.errors["outcome"])
    assert "outcome" in run.events
    assert run.report() == run.folder / "report.html"
    assert run.report().is_file()


def test_metrics_are_the_numbers_of_the_file_by_dotted_name(run):
    content = json.loads((run.folder / "metrics.json").read_text())
    assert run.metrics.loc["mot.hota", "value"] == content["mot"]["hota"]
    assert run.metrics.index.is_unique
    assert run.metrics.loc["mot.hota", "label"] == "HOTA in sight, %"
    assert run.metrics["value"].dtype == float


def test_a_folder_is_opened_again(run):
    opened = harness.open_run(run.folder)
    pd.testing.assert_frame_equal(opened.metrics, run.metrics)


def test_the_manifest_tells_the_call(run):
    manifest = json.loads((run.folder / "manifest.json").read_text())
    scene = run.folder.with_name("scene")
    assert manifest["command"].startswith(f"harness.run(replay={scene!r}, seed=3, tracker=echo_tracker, out=")


@pytest.mark.slow
def test_a_tracker_handed_over_is_one_named_by_its_place(run, tmp_path):
    place, scene = "tests.harness.stand_ins:echo_tracker", run.folder.with_name("scene")
    named = harness.run(replay=scene, seed=3, tracker=place, out=tmp_path / "named")
    pd.testing.assert_frame_equal(named.tracks, run.tracks)
    assert (named.folder / "config.toml").read_text() == (run.folder / "config.toml").read_text()


def test_a_tracker_that_no_module_has_by_name_runs_too(run, tmp_path):
    scene = run.folder.with_name("scene")
    handed = harness.run(replay=scene, tracker=lambda setting, options: EchoTracker(setting), out=tmp_path / "run")
    assert len(handed.tracks)


def test_a_run_that_breaks_part_way_says_so(run, tmp_path):
    class Breaking(EchoTracker):
        def step(self, scan):
            if scan.time_s > 0.25:
                raise RuntimeError("enough")
            return super().step(scan)

    scene = run.folder.with_name("scene")
    with pytest.raises(harness.RunError, match="enough"):
        harness.run(replay=scene, tracker=lambda setting, options: Breaking(setting), out=tmp_path / "run")


def test_a_run_is_no_worse_than_itself(run):
    compared = harness.compare(run, run.folder)
    assert not compared.regression
    assert {"metric", "verdict"} <= set(compared.verdicts)
    assert compared.verdicts[["difference", "ci95_low", "ci95_high"]].dtypes.eq("float64").all()
    assert len(repr(compared)) < 200


def test_completion_offers_the_public_names_alone():
    assert {name for name in dir(harness) if name[0] != "_"} == set(harness.__all__)


def test_notebooks_show_a_run_and_a_comparison_as_tables_with_names_escaped(tmp_path):
    folder = write_recorded_scene(tmp_path / "a<b")
    shown = harness.open_run(folder)._repr_html_()
    assert "href" not in shown
    (folder / "report.html").touch()
    assert f'href="{escape(str(folder))}/report.html"' in harness.open_run(folder)._repr_html_()
    assert {"net", "tracker", "seed"} <= {*harness.open_run(folder).about}
    assert "mot.hota" in shown
    assert "a&lt;b" in shown
    assert "a<b" not in shown
    compared = harness.compare(folder, folder)
    assert compared.outcome in compared._repr_html_()
    assert "<table" in compared._repr_html_()


def test_the_public_names_are_listed_where_an_interpreter_completes_them():
    for module in (harness, mmpf, harness.plugins):
        assert set(module.__all__) <= set(dir(module))
