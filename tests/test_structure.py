"""The structure of the code: imports in one direction, and limits on packages, imports between them and lines.

Limits only ever fall. Who must raise one says why in the commit.
"""

import ast
import re
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]


class Limits(NamedTuple):
    """The most that a package may hold, seen one level deep; other packages of this project count as one part each."""

    parts: int
    levels: int
    arrows: int


LIMITS = {"harness": Limits(20, 10, 108), "mmpf": Limits(16, 8, 63), "harness.scoring": Limits(6, 6, 14)}
MOST_LINES = {("harness", "mmpf"): 61_240, ("tests",): 37_230}
MOST_LATE_IMPORTS = 47
MOST_SHARED_NAMES = 0
MOST_FILES_ASKING_FOR_KIND = 3
KIND_OF_ROAD = re.compile(r"(graph|plane|direction_rad) is (not )?None")
SHARED_NAMES = {"__init__.py", "protocol.py", "options.py"}


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


FILES = {module_of(path): path for package in ("harness", "mmpf") for path in (ROOT / package).rglob("*.py")}


@cache
def imported(module: str) -> frozenset[str]:
    """Return the modules of this project that a module imports, wherever the statement stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            within = (f"{node.module}.{alias.name}" for alias in node.names)
            names |= {name if name in FILES else node.module for name in within}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return frozenset((names & FILES.keys()) - {module})


def arrows_within(package: str) -> dict[str, set[str]]:
    """Return which parts of a package import which; the other top-level package counts as one part."""

    def part_of(module: str) -> str:
        inside = module.startswith(f"{package}.")
        return ".".join(module.split(".")[: package.count(".") + 2]) if inside else module.split(".", maxsplit=1)[0]

    arrows: dict[str, set[str]] = {}
    for module in FILES:
        if module.startswith(f"{package}."):
            targets = {part_of(target) for target in imported(module)}
            arrows.setdefault(part_of(module), set()).update(
                targets - {part_of(module), package.split(".", maxsplit=1)[0]}
            )
    return arrows


def levels_of(arrows: dict[str, set[str]]) -> int:
    level: dict[str, int] = {}
    for part in TopologicalSorter(arrows).static_order():
        level[part] = 1 + max((level[below] for below in arrows.get(part, ())), default=0)
    return max(level.values())


def circle_in(arrows: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_in_a_circle():
    assert not circle_in({module: set(imported(module)) for module in FILES})


@pytest.mark.parametrize("package", ["harness", "mmpf"])
def test_no_parts_of_a_package_import_each_other_in_a_circle(package):
    assert not circle_in(arrows_within(package))


@pytest.mark.parametrize("package", LIMITS)
def test_a_package_stays_within_its_limits(package):
    arrows = arrows_within(package)
    parts = arrows.keys() | {target for targets in arrows.values() for target in targets}
    found = Limits(len(parts), levels_of(arrows), sum(map(len, arrows.values())))
    assert all(have <= most for have, most in zip(found, LIMITS[package], strict=True)), found


@pytest.mark.parametrize("folders", MOST_LINES)
def test_the_code_does_not_outgrow_its_limit(folders):
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    assert sum(len(path.read_text().splitlines()) for path in paths) <= MOST_LINES[folders]


def test_late_imports_stay_rare():
    late = sum(path.read_text().count("noqa: PLC0415") for path in FILES.values())
    assert late <= MOST_LATE_IMPORTS


def test_few_files_ask_which_kind_of_road_there_is():
    asking = [module for module, path in FILES.items() if KIND_OF_ROAD.search(path.read_text())]
    assert len(asking) <= MOST_FILES_ASKING_FOR_KIND, asking


def test_few_files_share_a_name_with_two_others():
    names = Counter(path.name for path in FILES.values())
    shared = {name: n for name, n in names.items() if n > 2 and name not in SHARED_NAMES}
    assert len(shared) <= MOST_SHARED_NAMES, shared


def test_a_class_name_has_one_meaning():
    """Each command's ``Options`` are its own; every other name is used once."""
    sources = (path.read_text() for path in FILES.values())
    classes = Counter(name for source in sources for name in re.findall(r"^ *class (\w+)[(:]", source, re.M))
    assert classes["Options"] > 1
    assert {name for name, n in classes.items() if n > 1} <= {"Options"}


def test_the_page_for_contributors_names_every_package():
    page = (ROOT / "CONTRIBUTING.md").read_text()
    parts = {part for package in ("harness", "mmpf") for part in arrows_within(package)}
    assert {part for part in parts if part.rsplit(".", 1)[-1] not in page} == set()
