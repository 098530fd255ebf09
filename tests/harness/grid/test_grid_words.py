"""What a user writes becomes these runs, options and keys, or one of these lines of what is wrong with it."""

from pathlib import Path

import pytest

from harness.common.errors import InputError
from harness.config.model import RunConfig
from harness.config.options import checked
from harness.grid.cells import PlannedRun, distinct_trackers, labels_markdown
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.options import GridOptions
from harness.grid.request import request_of
from tests.harness.stand_ins import echo_tracker


@pytest.mark.parametrize(
    ("asked", "option", "words"),
    [
        ({"densities": "5:65:0.01", "seeds": "100"}, "densities", "600100 runs, at most 100000"),
        ({"demands": "a", "densities": "20"}, "demands", "not both"),
        ({"replay": ("a.csv",), "densities": "20"}, "replay", "leave densities and demands out"),
        ({"replay": ("a.csv",), "demands": "a"}, "replay", "leave densities and demands out"),
        ({"ego": "auto"}, "ego", "add `replay`"),
        ({"nets": "curve"}, "nets", "not both"),
        ({"nets": "curve", "net": None, "replay": ("a.csv",)}, "nets", "leave nets out"),
        ({"replay": ("a/x.csv", "b/x.csv")}, "replay", "the same name"),
        ({"vary": ("=1",)}, "vary", "give KEY=START:STOP:STEP or KEY=A,B,C"),
        ({"vary": ("sensor.range_m=5", "sensor.range_m = 7")}, "vary", "given twice"),
        ({"vary": ("seed=1",)}, "vary", "for example `seeds` 10"),
        ({"vary": ("nonsense=1",)}, "vary", "no such setting"),
        ({"vary": ("tracker.particles=-5",)}, "vary", "for example `vary` sensor.range_m=40:160:20"),
        ({"trackers": "mmpf+update="}, "trackers", "is not KEY=VALUE; for example mmpf+update=max_likelihood"),
        ({"trackers": "pmbm=mmpf"}, "trackers", "pmbm is the name of another tracker; for example my-pmbm=mmpf"),
        ({"trackers": "truth=mmpf"}, "trackers", "truth is the name of another tracker"),
        ({"trackers": "a=mmpf,a=pmbm"}, "trackers", "another tracker is called a too"),
        ({"trackers": "pmbm", "models": "cvm"}, "models", "only mmpf takes them"),
        ({"trackers": "pmbm", "particles": 10}, "particles", "only mmpf takes them"),
        ({"trackers": "pmbm", "settings": ("tracker.options.x=1",)}, "settings", "pmbm+x=VALUE"),
        ({"trackers": "lmb,pmbm", "vary": ("tracker.particles=5,6",)}, "vary", "lmb+particles=VALUE"),
        ({"densities": "70"}, "densities", "give 5 to 65"),
        ({"trackers": ","}, "trackers", "for example"),
        ({"densities": "x"}, "densities", "for example"),
    ],
)
def test_what_is_wrong_with_a_grid_is_told_with_its_option_and_the_fix(asked, option, words):
    with pytest.raises(InputError) as caught:
        plan_grid(GridRequest(**{"seeds": "1"} | asked))
    assert f"`{option}`" in str(caught.value)
    assert words in str(caught.value)


def test_models_go_with_mmpf_only_and_not_with_a_variant_that_names_its_own():
    asked = GridRequest(densities="20", seeds="1", models="cvm,cam", trackers="mmpf+model=idm,mmpf,stonesoup-gnn")
    assert [(run["variant"], run["model"]) for run in (run.identity() for run in plan_grid(asked).runs)] == [
        ("mmpf+model=idm", "idm"), ("mmpf", "cvm"), ("mmpf", "cam"), ("stonesoup-gnn", None),
    ]  # fmt: skip


def test_a_label_names_a_tracker_with_its_settings():
    grid = plan_grid(GridRequest(densities="20", seeds="1", trackers="pmbm,calm=pmbm+lon_noise=1.5"))
    assert [run.variant for run in grid.runs] == ["pmbm", "calm"]
    assert [run.config.tracker.options for run in grid.runs] == [{}, {"lon_noise": 1.5}]
    assert "- calm: `pmbm+lon_noise=1.5`" in labels_markdown(grid)


def test_the_runs_of_a_grid_stand_in_this_order_with_these_settings():
    grid = plan_grid(
        GridRequest(
            densities="20,30", seeds="4:6", models="cvm", trackers="mmpf+joint.noise.learned=false,a.b:c,pmbm",
            vary=("sensor.range_m=40,60.5", "tracker.particles=100,200", "tracker.believes.noise_factor=1,2"),
            particles=50, duration_s=7.5, sensor="radar",
            settings=("tracker.options.reporting.reported_std_lon_m=9", "sensor.clutter_per_scan=0.5"),
        )
    )  # fmt: skip
    assert grid.axes == ("sensor.range_m", "tracker.particles", "tracker.believes.noise_factor")
    assert not grid.is_replay
    places = [(density, range_m, seed) for density in (20.0, 30.0) for range_m in (40.0, 60.5) for seed in (4, 5)]
    assert [
        (cell.config.traffic.density, cell.config.sensor.overrides["range_m"], cell.config.seed) for cell in grid.cells
    ] == places
    both = [(particles, factor) for particles in (100.0, 200.0) for factor in (1.0, 2.0)]
    first = grid.cells[0].runs
    assert [(run.variant.partition("+")[0], *list(run.varied.values())[1:]) for run in first] == [
        *(("mmpf", *each) for each in both), *(("a.b:c", *each) for each in both), ("pmbm", 1.0), ("pmbm", 2.0),
    ]  # fmt: skip
    for run in first:
        config, takes = run.config, run.config.tracker.name != "pmbm"
        assert (config.traffic.duration_s, config.sensor.profile) == (7.5, "radar")
        assert config.sensor.overrides == {"range_m": 40, "clutter_per_scan": 0.5}
        assert isinstance(config.sensor.overrides["range_m"], int)
        assert config.tracker.believes.noise_factor == run.varied["tracker.believes.noise_factor"]
        assert ("reporting" in config.tracker.options) == takes
        assert config.tracker.particles == (run.varied["tracker.particles"] if takes else None)
        assert config.tracker.model == ("cvm" if config.tracker.name == "mmpf" else None)
    assert first[0].config.tracker.options["joint"] == {"noise": {"learned": False}}
    assert [each.tracker.name for each in distinct_trackers(grid)] == ["mmpf"] * 4 + ["a.b:c"] * 4 + ["pmbm"] * 2


def run_of(variant="mmpf", varied=None, mismatch=None, **settings) -> PlannedRun:
    traffic = {"net": "us101", "density": 20.0} | settings.pop("traffic", {})
    content = {"seed": 3, "traffic": traffic, "tracker": {"name": "mmpf", "model": "cvm"}} | settings
    return PlannedRun(RunConfig.model_validate(content), variant, varied or {}, mismatch)


def test_the_key_of_a_run_reads_as_what_it_is_of_and_tells_it_from_others():
    run = run_of()
    words, _, digits = run.key.rpartition("-")
    assert (words, len(digits)) == ("us101-d20-s3-mmpf-cvm", 12)
    assert int(digits, 16) >= 0
    others = [
        run_of(mismatch="noise"), run_of("mmpf+a=1"), run_of(seed=4), run_of(traffic={"density": 20.5}),
        run_of(traffic={"density": None, "demand": "us101-0750"}), run_of(tracker={"name": "pmbm"}),
    ]  # fmt: skip
    assert [other.key.rpartition("-")[0] for other in others] == [
        "us101-d20-s3-mmpf-cvm", "us101-d20-s3-mmpf-cvm", "us101-d20-s4-mmpf-cvm", "us101-d20.5-s3-mmpf-cvm",
        "us101-us101-0750-s3-mmpf-cvm", "us101-d20-s3-pmbm",
    ]  # fmt: skip
    assert len({other.key for other in (run, *others)}) == 7
    far = run_of(traffic={"net": "/" + "a" * 60 + "/ü b.sumocfg", "density": None}, tracker={"name": "x.y:z" * 5})
    readable = far.key.rpartition("-")[0]
    assert readable == ("-" + "a" * 60 + "-ü-b.sumocfg-s3-" + "x.y-z" * 5)[-80:].lstrip("-.")


def asked(**options) -> GridRequest:
    return request_of(checked(GridOptions, options, "stress"))


def test_options_of_python_ask_for_the_same_grid_as_typed_ones(tmp_path):
    (tmp_path / "b.csv").touch()
    (tmp_path / "a.csv").touch()
    (tmp_path / ".hidden").touch()
    (tmp_path / "folder").mkdir()
    assert asked() == GridRequest(densities="5:65:10", seeds="10")
    assert asked(nets=["curve", Path("x/y")]) == GridRequest(net=None, nets="curve,x/y")
    assert asked(net="x.sumocfg") == GridRequest(net="x.sumocfg")
    assert asked(net="x.sumocfg", densities="7").densities == "7"
    assert asked(
        net="curve", densities=[10, 20.5], trackers=["pmbm", echo_tracker], models=["gmm", "cvm"], seeds=range(2, 5),
        vary={"sensor.range_m": [40, 80], "tracker.particles": "5,6"}, duration=9.0, particles=70, sensor="radar",
        settings={"sensor.range_m": 60}, mismatch=True,
    ) == GridRequest(
        net="curve", densities="10,20.5", trackers="pmbm,tests.harness.stand_ins:echo_tracker", models="gmm,cvm",
        seeds="2:5", vary=("sensor.range_m=40,80", "tracker.particles=5,6"), duration_s=9.0, particles=70,
        sensor="radar", settings=("sensor.range_m=60",), mismatch=True,
    )  # fmt: skip
    replayed = asked(replay=tmp_path, format="ngsim", ego="auto")
    files = (str(tmp_path / "a.csv"), str(tmp_path / "b.csv"))
    assert replayed == GridRequest(
        net=None, replay=files, ego="auto", seeds="1", settings=('traffic.recording.format="ngsim"',)
    )
    assert asked(replay=[files[1], files[0]], seeds=4).replay == files[::-1]
    assert asked(replay=files[0], seeds="4").seeds == "4"
    assert asked(densities=20, demands=None, seeds=[7]).seeds == "7:8"
    assert asked(demands="a", net=None).densities is None


def test_a_folder_that_is_a_recording_itself_is_one_file_and_one_without_files_is_refused(tmp_path):
    for name, inside in (("tracks", "01_tracks.csv"), ("run", "manifest.json")):
        (tmp_path / name).mkdir()
        (tmp_path / name / inside).touch()
        assert asked(replay=tmp_path / name).replay == (str(tmp_path / name),)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError) as caught:
        asked(replay=tmp_path / "empty")
    assert str(caught.value) == (
        f"`replay`: {tmp_path / 'empty'} has no files; give files of recorded traffic, or their folder"
    )
