"""The house: no arrow between modules runs up, and none in a circle."""

import ast
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("harness", "mmpf")


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


FILES = {name_of(path): path for package in PACKAGES for path in (ROOT / package).rglob("*.py")}


def imported(module: str) -> set[str]:
    """Return the modules of this project that a module imports, wherever the statement stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            within = (f"{node.module}.{alias.name}" for alias in node.names)
            names |= {name if name in FILES else node.module for name in within}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return (names & FILES.keys()) - {module}


def room_of(module: str) -> str:
    return ".".join(module.split(".")[:2])


def circle_in(arrows: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return error.args[1]
    return []


ARROWS = {module: imported(module) for module in FILES}


def test_no_modules_import_each_other_in_a_circle():
    assert not circle_in(ARROWS)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_rooms_of_a_package_stand_on_one_another(package):
    rooms: dict[str, set[str]] = defaultdict(set)
    for module, targets in ARROWS.items():
        own = room_of(module)
        if own.startswith(f"{package}."):
            rooms[own] |= {room_of(target) for target in targets} - {own, *PACKAGES}
    assert not circle_in(rooms)
