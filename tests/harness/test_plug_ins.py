import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import harness
from harness.commands.app import run_command_line
from harness.commands.settings_table import all_settings
from harness.common.errors import RunError
from harness.decisions.decide import driver_of
from harness.export.formats import export_run
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.sensor.profiles import sensor_settings
from harness.trackers.catalogue import build_tracker
from harness.trackers.protocol import TrackerSetting
from harness.truth.recorded.source import open_recorded_traffic
from mmpf import Memoryless, MixtureTracker, SensorModel, highway, motion_model, motion_models
from mmpf.motion.protocol import checked_step
from mmpf.registry import UnknownNameError, entry_points_of
from tests.harness.grid.test_cluster import dask_cluster
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.stand_ins import SteadyTraffic, observing

pytestmark = pytest.mark.usefixtures("no_pictures")

EXAMPLE = Path(__file__).parents[1] / "plugin_example"


def install(folder: Path, name: str, entry_points: dict[str, dict[str, str]]) -> None:
    """Leave what an installer leaves of a package: its name and its entry points."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [
        line
        for group, points in entry_points.items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in points.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    entry_points_of.cache_clear()


def returning(what: str) -> str:
    """Return the source of a tracker whose step returns an expression."""
    return (
        f"class Odd:\n    def step(self, scan):\n        return {what}\ndef make(setting, options):\n    return Odd()"
    )


@pytest.fixture
def example(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    install(folder, project["name"], project["entry-points"])
    shutil.copy(EXAMPLE / "plugin_example.py", folder)
    monkeypatch.syspath_prepend(folder)
    yield folder
    sys.modules.pop("plugin_example", None)
    entry_points_of.cache_clear()


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    """Return what writes a module of the user's own, which is there for as long as the test is."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(name: str, code: str) -> None:
        (tmp_path / f"{name}.py").write_text(f"{code}\n")
        monkeypatch.delitem(sys.modules, name, raising=False)

    return write


@pytest.fixture
def setting():
    return TrackerSetting(road=highway(), sensor=SensorModel(), rng=np.random.default_rng(0))


def test_a_tracker_of_another_package_is_found_by_its_name(example, setting):
    assert type(build_tracker("echo", setting, {})).__name__ == "EchoTracker"


def test_a_motion_model_of_another_package_is_found_by_its_name_and_is_listed(example):
    assert "standstill" in set(motion_models)
    state = np.ones((6, 3))
    model = motion_model("standstill")
    moved, _ = model.propagate(state, np.empty((0, 3)), None, 0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(moved, state)


def test_a_motion_model_that_no_package_declares_is_named_by_its_place(example):
    assert motion_model("plugin_example:Standstill").name == "standstill"
    with pytest.raises(UnknownNameError, match="nowhere_at_all"):
        motion_model("nowhere_at_all:Model")


@pytest.mark.parametrize("name", ["sunday", "plugin_example:Sunday"])
def test_a_driver_of_another_package_is_found_by_its_name_or_its_place(example, name):
    assert type(driver_of(name)).__name__ == "Sunday"
    with pytest.raises(harness.InputError, match=r"choose one of hdm, idm, mobil, sunday, .*; did you mean sunday\?"):
        driver_of("sundae")


@pytest.mark.parametrize("name", ["far-sighted", "plugin_example:far_sighted"])
def test_a_sensor_of_another_package_is_found_by_its_name_or_its_place(example, name):
    assert sensor_settings(name, {}).range_m == 250.0
    assert sensor_settings(name, {"range_m": 90.0}).range_m == 90.0


@pytest.mark.parametrize("name", ["queue", "plugin_example:read_queue"])
def test_a_format_of_another_package_is_read_by_its_name_or_its_place(name, example, tmp_path):
    file = tmp_path / "queue.bin"
    file.write_bytes(bytes([1, 21, 41]))
    config = resolve_run_config(options={"replay": str(file), "format": name, "tracker": "echo", "duration": 1.0})
    assert (config.traffic.net, config.traffic.recording.format) == ("recording", name)
    finished = run(config, out=tmp_path / "run")
    assert set(finished.metrics["recording"]["vehicles_left_out"]) == set()
    assert finished.metrics["recording"]["vehicles_kept"] == 3


def test_a_file_is_never_taken_for_another_packages_format_that_nobody_names(example, tmp_path):
    file = tmp_path / "queue.txt"
    file.write_text("a queue")
    with pytest.raises(harness.InputError, match="name it with `format`"):
        resolve_run_config(options={"replay": str(file)})
    with pytest.raises(harness.InputError, match=r"known are commonroad, .*, queue, or module:function"):
        resolve_run_config(options={"replay": str(file), "format": "queu"})
    assert "plugin_example" not in sys.modules


@pytest.mark.parametrize(
    ("returned", "told"),
    [
        ("None", "NoneType, not ReadTraffic"),
        ("replace(good, road=None)", "road is NoneType, not CorridorRoad"),
        ("replace(good, names=good.names[[0, 0, 1]])", "names has one name twice"),
        ("replace(good, names=['a', 'b', 'c'])", "names is not an array of strings"),
        ("with_rows(lon_m=good.rows.lon_m[:5])", "rows.lon_m has shape (5,), rows.vehicle (93,)"),
        ("with_rows(speed_mps=good.rows.speed_mps.tolist())", "rows.speed_mps is list, not an array"),
        ("with_rows(vehicle=good.rows.vehicle + 1)", "rows.vehicle has 1 to 3, and names has 3 entries"),
        ("with_rows(vehicle=1.0 * good.rows.vehicle)", "rows.vehicle is float64, not int64"),
        ("replace(good, vehicles_read=2)", "vehicles_read is 2, less than the vehicles"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("with_rows(time_s=good.rows.time_s * np.nan)", "time_s of vehicle car0 is missing or not finite"),
    ],
)
def test_a_reader_that_returns_nonsense_is_told_which_check_fails(returned, told, example, tmp_path, own_module):
    own_module(
        "odd_reader",
        "from dataclasses import replace\nimport numpy as np\nfrom plugin_example import read_queue\n"
        "def read(path):\n    good = read_queue(path)\n"
        "    with_rows = lambda **columns: replace(good, rows=replace(good.rows, **columns))\n"
        f"    return {returned}",
    )
    (tmp_path / "queue.bin").write_bytes(bytes([1, 21, 41]))
    with pytest.raises(harness.InputError) as error:
        open_recorded_traffic(tmp_path / "queue.bin", "odd_reader:read", "recording", "auto", 3.0)
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("def read(path, net, more): pass", "takes \\(path\\), or \\(path, net\\)"),
        ("read = 5", "no class or function"),
        ("", "can't import"),
    ],
)
def test_what_is_no_reader_is_told_before_anything_is_read(written, told, tmp_path, own_module):
    own_module("no_reader", written)
    (tmp_path / "file").write_text("x")
    with pytest.raises(harness.InputError, match=f"^`format` no_reader:read: .*{told}"):
        resolve_run_config(options={"replay": str(tmp_path / "file"), "format": "no_reader:read"})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["speeds", "plugin_example:write_speeds"])
def test_an_export_format_of_another_package_is_found_by_its_name_or_its_place(name, example, tmp_path):
    folder = write_recorded_scene(tmp_path / "run")
    (file,) = export_run(folder, name)
    assert file == folder / "export" / name.replace(":", "-") / "speeds.txt"
    assert "near 20.00" in file.read_text()
    assert export_run(folder, name) == [file]
    with pytest.raises(harness.InputError, match=r"choose from .*csv, .*, speeds, or module:function"):
        export_run(folder, "sped")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("returned", "told"),
    [
        ("None", "it returned NoneType, not the list of written paths"),
        ("[str(folder)]", "it returned a list with str, not the list of written paths"),
        ("[folder / 'none.txt']", "none.txt, which is not a file in the given folder"),
        ("[Path(__file__)]", "odd_export.py, which is not a file in the given folder"),
        ("[]", "it returned no file"),
        ("run.nothing", "AttributeError"),
    ],
)
def test_an_export_that_returns_nonsense_is_told_which_check_fails(returned, told, tmp_path, own_module):
    own_module("odd_export", f"from pathlib import Path\ndef write(run, folder):\n    return {returned}")
    folder = write_recorded_scene(tmp_path / "run")
    with pytest.raises(harness.InputError, match=r"^`to` odd_export:write: ") as error:
        export_run(folder, "odd_export:write")
    assert told in str(error.value)
    assert not list((folder / "export").iterdir())


@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("def make(setting, options): return 5", "it returned int, which has no method step(scan)"),
        (returning("None"), "step returned NoneType, not Tracks"),
        (returning("dataclasses.replace(Tracks.none(), track_id=np.arange(3))"), "lon_m has shape (0,), track_id (3,)"),
        (returning("dataclasses.replace(Tracks.none(), lon_m=[])"), "lon_m is list, not an array"),
    ],
)
def test_a_tracker_that_returns_nonsense_is_told_what_is_wrong_with_it(written, told, tmp_path, own_module):
    own_module("odd_tracker", f"import dataclasses\nimport numpy as np\nfrom mmpf import Tracks\n{written}")
    config = resolve_run_config(options={"tracker": "odd_tracker:make", "duration": 1.0})
    with pytest.raises((harness.InputError, RunError)) as error:
        run(config, out=tmp_path / "run", open_snapshots=observing(SteadyTraffic()))
    assert told in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("step", "told"),
    [
        ("lambda *_: None", "state of shape (), not (6, "),
        ("lambda state, *_: state[:4]", "state of shape (4, "),
        ("lambda state, *_: state * np.nan", "a state that is not finite"),
    ],
)
def test_a_motion_model_that_returns_nonsense_is_told_what_is_wrong_with_it(step, told, setting):
    model = Memoryless("odd", eval(step))
    tracker = MixtureTracker(setting.road, setting.sensor, model, setting.rng)
    first, second, *_ = observing(SteadyTraffic(steps=3))(resolve_run_config(options={}))
    tracker.step(first.observation.scan)
    with pytest.raises(ValueError, match=r"^motion model odd: propagate returned") as error:
        tracker.step(second.observation.scan)
    assert told in str(error.value)


@pytest.mark.parametrize("laid_out", [np.asfortranarray, np.float32, lambda state: np.broadcast_to(state, state.shape)])
def test_a_motion_model_may_return_numbers_of_any_kind_and_order(laid_out):
    state = np.arange(12.0).reshape(6, 2)
    moved, _ = checked_step(Memoryless("own", laid_out), (laid_out(state), state), state, state)
    assert (moved.dtype, moved.flags.carray, moved.tolist()) == (np.float64, True, state.tolist())


@pytest.mark.parametrize(
    ("option", "written", "told"),
    [
        ("tracker", "def make(setting, options): return {}['gain']", "can't be built (KeyError: 'gain', odd_parts.py"),
        ("tracker", "def make(road): return None", "with two arguments, setting (what the tracker may know) and"),
        ("sensor", "def make(): return __import__('json').loads('{')", "line 1 column 2 (char 1), odd_parts.py line 1"),
        ("sensor", "def make(which): return None", "missing 1 required positional argument: 'which'"),
        ("sensor", "def make(): return None", "it returned NoneType, not SensorSettings"),
        ("model", "def make(): return {}['weights']", "can't be built (KeyError: 'weights', odd_parts.py line"),
        ("model", "class make: pass", "is make, which has no name"),
        ("model", "from mmpf import Memoryless\nclass make(Memoryless):\n    latent_size = 2\n"
         "    def __init__(self): super().__init__('odd', None)", "draw_latents returned shape (0, 2)"),
        ("model", "class make:\n    name, latent_size, propagate = 'odd', 0, None\n"
         "    def draw_latents(self, *_): return None", "draw_latents returned NoneType for 2 particles"),
    ],
)  # fmt: skip
def test_what_can_not_be_built_is_told_before_the_run_and_where(option, written, told, own_module, refused):
    own_module("odd_parts", written)
    line = refused("run", "--duration", "0.5", f"--{option}", "odd_parts:make")
    assert line.startswith(f"error: --{option}")
    assert told in line
    assert not Path("results").exists() or not list(Path("results").iterdir())


def test_the_traceback_of_ones_own_code_is_shown_on_request(own_module, monkeypatch, capsys):
    own_module("odd_parts", "def make(setting, options): return {}['gain']")
    monkeypatch.setenv("HARNESS_TRACEBACK", "1")
    assert run_command_line(["run", "--tracker", "odd_parts:make"]) == 2
    assert 'odd_parts.py", line 1, in make' in capsys.readouterr().err


def test_a_broken_plug_in_is_told_in_one_line_and_breaks_no_other(example, setting, refused):
    install(example, "broken-one", {"harness.trackers": {"broken": "no_such_module_at_all:Tracker"}})
    assert build_tracker("echo", setting, {})
    told = refused("run", "--tracker", "broken")
    assert "broken-one" in told
    assert "no_such_module_at_all" in told


def test_plug_ins_are_listed_with_what_they_say_of_themselves_or_why_they_are_broken(example):
    gone = {"broken": "no_such_module_at_all:Thing"}
    groups = ("mmpf.motion_models", "harness.sensors", "harness.recording_formats")
    install(example, "broken-one", dict.fromkeys(groups, gone))
    meanings = {row.key: row.meaning for row in all_settings()}
    assert meanings["tracker.name=echo"] == "Every detection is a track of its own for one step."
    assert meanings["traffic.recording.format=queue"].startswith("Read a file of bytes")
    assert meanings["traffic.recording.format=fcd"].startswith("Read floating-car data")
    assert meanings["tracker.model=standstill"] == "Every vehicle stays where it is."
    for key in ("tracker.model", "sensor.profile", "traffic.recording.format"):
        assert "no_such_module_at_all" in meanings[f"{key}=broken"]


def test_a_name_that_two_packages_declare_is_refused_with_both(example, setting):
    install(example, "twin", {"harness.trackers": {"echo": "plugin_example:EchoTracker"}})
    with pytest.raises(harness.InputError, match="plugin-example and twin"):
        build_tracker("echo", setting, {})


def test_no_plug_in_takes_the_place_of_a_built_in_tracker(example, setting):
    install(example, "usurper", {"harness.trackers": {"mmpf": "plugin_example:EchoTracker"}})
    assert type(build_tracker("mmpf", setting, {"particles": 50})).__name__ == "MixtureTracker"


TRACKERS_OF_OTHERS = [
    *("echo", "mmpf+particles=50+model=standstill"),
    *("plugin_example:EchoTracker", "mmpf+particles=50+model=plugin_example:Standstill"),
]


def check_grids_of_plug_ins(folder, **where):
    """Make a simulated and a recorded grid of plug-ins; trackers and models are named both ways."""
    few = {"duration": 1.0, "trackers": TRACKERS_OF_OTHERS, **where}
    (folder / "queue.bin").write_bytes(bytes([1, 21, 41]))
    recorded = {"replay": folder / "queue.bin", "format": "plugin_example:read_queue", "ego": "auto"}
    simulated = {"densities": [20], "seeds": 1, "sensor": "plugin_example:far_sighted"}
    for name, traffic in (("simulated", simulated), ("recorded", recorded)):
        grid = harness.stress(out=folder / name, **traffic, **few)
        assert list(grid.runs["succeeded"]) == [True] * 4, list(grid.runs["error"])


@pytest.mark.slow
def test_plug_ins_work_in_the_worker_processes_of_a_stress_test(example, tmp_path):
    check_grids_of_plug_ins(tmp_path, workers=1)


@pytest.mark.slow
def test_plug_ins_work_on_dask(example, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(example))
    with dask_cluster(tmp_path) as (address, _):
        check_grids_of_plug_ins(tmp_path, scheduler=address)


def test_the_reader_of_the_documentation_reads_what_it_says(tmp_path, own_module):
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "recording.md").read_text()
    code = page.partition("## A format of your own")[2].partition("```python\n")[2].partition("```")[0]
    own_module("documented_reader", code)
    file = tmp_path / "drive.txt"
    file.write_text("\n".join(f"{car};{0.1 * k};{30 * car + k};5.5;10" for car in (3, 8) for k in range(20)))
    truth = open_recorded_traffic(file, "documented_reader:read", "recording", "3", 5.0)
    frame = list(truth.frames())[10]
    assert dict(zip(frame.vehicle_id, frame.lon_m, strict=True)) == pytest.approx({"3": 100.0, "8": 250.0})
