import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.common.errors import InputError
from harness.config.model import RunConfig
from harness.running.resolve import resolve_run_config, write_config
from harness.truth.network.names import shipped_networks


def test_later_layers_win(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text('seed = 1\n[traffic]\nduration_s = 10.0\n[tracker]\nmodel = "cam"\n')
    assert resolve_run_config().seed == 0
    assert resolve_run_config(file).seed == 1
    assert resolve_run_config(file, {"seed": 2}).seed == 2
    config = resolve_run_config(file, {"seed": 2, "duration": None}, ["seed=3"])
    assert (config.seed, config.traffic.duration_s, config.tracker.model) == (3, 10.0, "cam")


def test_another_tracker_does_not_inherit_the_options_of_an_earlier_layers_tracker(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text('[tracker]\nname = "mmpf"\nmodel = "cam"\n[tracker.options.joint.association]\ngate_std = 4.0\n')
    assert resolve_run_config(file, {"tracker": "stonesoup-gnn"}).tracker.all_options() == {}
    same = resolve_run_config(file, {"tracker": "mmpf", "particles": 50}).tracker.all_options()
    assert (same["model"], same["particles"], same["joint"]) == ("cam", 50, {"association": {"gate_std": 4.0}})


def test_an_option_that_the_tracker_does_not_take_is_told_with_the_trackers_that_do():
    with pytest.raises(InputError, match="`model`: pmbm takes none; these trackers do: mmpf"):
        resolve_run_config(options={"tracker": "pmbm", "model": "idm"})


def test_a_later_density_replaces_an_earlier_demand(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text('[traffic]\ndemand = "jam"\n')
    assert resolve_run_config(file).traffic.density is None
    traffic = resolve_run_config(file, {"density": 30.0}).traffic
    assert (traffic.demand, traffic.density) == (None, 30.0)


def test_a_sumo_configuration_keeps_its_own_demand():
    assert resolve_run_config(options={"net": "my.sumocfg"}).traffic.density is None


@pytest.mark.parametrize(
    ("key", "meant"), [("traffic.densty", "traffic.density"), ("range_m", "sensor.range_m or tracker.believes.range_m")]
)
def test_unknown_key_is_told_with_its_nearest(key, meant):
    with pytest.raises(InputError, match=f"{key}'; did you mean {meant}"):
        resolve_run_config(settings=[f"{key}=20"])


@pytest.mark.parametrize("text", ["a = [", "= 3", "[traffic\n", "\x00"])
def test_broken_toml_is_told_with_its_file(tmp_path, text):
    file = tmp_path / "broken.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"`config`: .*broken\.toml: broken, or no TOML file"):
        resolve_run_config(file)


@pytest.mark.parametrize("word", ["density", "=3", "traffic..net=a", "seed=1.5", "seed.x=1"])
def test_a_setting_that_makes_no_sense_is_refused(word):
    with pytest.raises(InputError):
        resolve_run_config(settings=[word])


def test_settings_reach_sensor_and_tracker_as_toml_values_or_words():
    config = resolve_run_config(
        settings=[
            "sensor.range_m=80",
            "tracker.options.joint.association.gate_std=4.0",
            "tracker.options.flag=true",
            "sensor.a=b",
        ]
    )
    assert config.sensor.overrides == {"range_m": 80, "a": "b"}
    assert config.tracker.options == {"joint": {"association": {"gate_std": 4.0}}, "flag": True}


def test_folder_name_tells_the_settings_and_holds_no_separator():
    assert (
        resolve_run_config(options={"seed": 3, "density": 12.5}).default_folder_name() == "us101-mmpf-residual-d12.5-s3"
    )
    name = resolve_run_config(options={"net": "a/b c.sumocfg", "tracker": "x.y:z"}).default_folder_name()
    assert name == "b-c-x.y-z-s0"


@given(
    seed=st.integers(0, 2**31 - 1),
    density=st.floats(5.0, 65.0),
    duration=st.floats(0.1, 1000.0),
    word=st.text(min_size=1, alphabet=st.characters(exclude_categories=["Cs"])),
    number=st.floats(allow_nan=False),
)
def test_a_written_configuration_reads_back_the_same(tmp_path_factory, seed, density, duration, word, number):
    config = RunConfig.model_validate(
        {
            "seed": seed,
            "traffic": {"net": word, "density": density, "duration_s": duration},
            "sensor": {"profile": "radar", "range_m": 50.0},
            "tracker": {"options": {"nested": {"number": number, "word": word}, "flag": False}},
        }
    )
    file = tmp_path_factory.mktemp("config") / "config.toml"
    write_config(config, file)
    assert resolve_run_config(file) == config


def test_a_network_that_names_no_default_demand_is_driven_at_thirty_vehicles_per_km_and_lane(tmp_path):
    source = shipped_networks()["us101"]
    text = (source / "network.toml").read_text()
    (tmp_path / "network.toml").write_text(text.replace('default_demand = "us101-0805"', ""))
    traffic = resolve_run_config(options={"net": str(tmp_path)}).traffic
    assert (traffic.demand, traffic.density) == (None, 30.0)
