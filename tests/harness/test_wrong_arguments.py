"""Every wrong argument of a call from Python is an ``InputError`` of one line."""

import pytest

import harness
from harness.api import folder_of_run
from tests.harness.recorded_scene import write_recorded_scene

pytestmark = pytest.mark.usefixtures("read_here")

NO_TEXT = "\ud800"
MUTE = type("Mute", (), {"__repr__": lambda self: 1 / 0})()
CALLS = [
    *(("stress", {"seeds": seeds}) for seeds in ([0.5], ["a"], [None], [1e300], [[1]], b"1", [True], MUTE)),
    *(("stress", {"densities": densities}) for densities in ([None], [float("nan")], [[1]], b"2", object())),
    *(("open_run", {"folder": folder}) for folder in (None, 3, b"x", [], NO_TEXT, "a\0b", "x" * 5000)),
    *(("compare", {"a": side, "b": "x"}) for side in (None, 3, b"x", [], NO_TEXT)),
    *(("compare", {"tolerance": value}) for value in ("a", -0.01, float("nan"), True, 1.5, None, MUTE)),
    *(("compare", wrong) for wrong in ({"primary": []}, {"primary": 3}, {"primary": [3]}, {"allow_different": "x"})),
    *(("run", {name: NO_TEXT}) for name in ("net", "out", "config", "replay", "tracker", "model", "sensor")),
    *(("run", {"settings": value}) for value in ({"a": object()}, {NO_TEXT: 1}, [3], "a=1")),
    *(("run", {"tracker": name}) for name in (":", "mmpf:", "a:b:c", 3)),
    *(("run", {"seed": value}) for value in (1.0, True)),
]


@pytest.mark.parametrize(("name", "options"), CALLS, ids=[f"{name}-{number}" for number, (name, _) in enumerate(CALLS)])
def test_every_wrong_argument_raises_the_documented_error(name, options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # The same in the process itself; what goes to a process of its own and comes back is in test_api.
    monkeypatch.setattr("harness.api.survived", lambda function, arguments, named: folder_of_run(*arguments))
    scene = write_recorded_scene(tmp_path / "scene")
    rest = {"compare": {"a": scene, "b": scene}, "stress": {"densities": [20.0], "out": "grid"}}.get(name, {})
    with pytest.raises(harness.InputError):
        getattr(harness, name)(**{**rest, **options})


def test_what_a_library_says_in_several_lines_is_one():
    assert str(harness.InputError("two\nlines")) == "two lines"
