"""Named things are imported when they are asked for, and a name that leads nowhere is answered in one line."""

import sys
from pathlib import Path

import pytest

from mmpf.registry import Entry, PartMissingError, Registry, UnknownNameError


@pytest.fixture
def things(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Registry[object]:
    (tmp_path / "lazy_thing.py").write_text("def whole(): return 5\n")
    (tmp_path / "lazy_part.py").write_text("import no_such_package\n")
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("lazy_thing", "lazy_part"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    part, named_part = Entry("lazy_part:part", extra="some"), Entry("lazy_part:part", extra="some", needs="Some Part")
    entries = {"whole": Entry("lazy_thing:whole"), "part": part, "named": named_part, "bare": Entry("lazy_part:part")}
    return Registry("thing", "nobody.declares", entries)


def test_nothing_is_imported_before_it_is_asked_for(things: Registry[object]) -> None:
    assert list(things) == ["bare", "named", "part", "whole"]
    assert things.names() == things.own == ("whole", "part", "named", "bare")
    assert "lazy_thing" not in sys.modules
    whole = things["whole"]
    assert callable(whole)
    assert whole() == 5
    assert things["lazy_thing:whole"] is whole


@pytest.mark.parametrize(("name", "what"), [("part", "no_such_package"), ("named", "Some Part")])
def test_a_part_that_is_not_installed_is_named_with_its_installation(
    things: Registry[object], name: str, what: str
) -> None:
    with pytest.raises(PartMissingError, match=rf"^{name} needs {what}, .*-c constraints.txt '\.\[some\]'$"):
        things[name]
    with pytest.raises(ModuleNotFoundError, match="no_such_package"):
        things["bare"]


def test_an_unknown_name_is_answered_with_all_names_and_those_near_it(things: Registry[object]) -> None:
    with pytest.raises(UnknownNameError, match=r"^unknown thing 'zzz'; known are: bare, named, part, whole$"):
        things["zzz"]
    near = {"hole": "; did you mean whole?", "lazy_thing:hole": "; did you mean whole?"}
    for name, told in {**near, "./lazy:a": "folder or .py", "lazy_thing.py:a": ".py"}.items():
        assert things.problem(name).endswith(told)


def test_a_name_is_taken_once(things: Registry[object]) -> None:
    things.register("mine")(print)
    assert things["mine"] is print
    for name in ("mine", "whole"):
        with pytest.raises(ValueError, match=f"a thing named '{name}' is registered already"):
            things.register(name)(len)
    assert not things.is_outside("mine")
    assert things.is_outside("lazy_thing:whole")
    assert not things.is_outside("zzz")
