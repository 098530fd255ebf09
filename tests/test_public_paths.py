"""What docs teach is imported from ``harness``, ``harness.plugins`` and ``mmpf``, and from nothing deeper."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import harness.plugins
import mmpf

ROOT = Path(__file__).parents[1]
PAGES = (
    ROOT / "README.md",
    *sorted(
        page for page in (ROOT / "docs").glob("*/*.md") if page.parent.name not in ("_build", "gallery", "reference")
    ),
    *sorted((ROOT / "docs" / "reference").glob("python-*.md")),
    *sorted((ROOT / "docs" / "examples").glob("*.py")),
    ROOT / "tests" / "plugin_example" / "plugin_example.py",
)
PUBLIC = ("harness.plugins", "harness", "mmpf")
COMMANDS = ("harness.lab.tuning.search", "harness.lab.fit.lidar_view")
"""Modules that are run by ``python -m``, and imported by no page."""
DOTTED = re.compile(r"(?<![\w./-])(?:harness|mmpf)(?:\.(?!md\b)[A-Za-z_]\w*)+")
IMPORT = re.compile(r"^\s*(?:>>> )?(?:from|import) ((?:harness|mmpf)[\w.]*)(?: import (.+))?$", re.MULTILINE)
ENTRY_POINTS = re.compile(r'entry-points\."[^"]*"|`harness\.(?:sensors|drivers|trackers)`')


def is_public(dotted: str) -> bool:
    """Whether a dotted name is a public module, or an attribute that such a module hands on."""
    if dotted in PUBLIC:
        return True
    module = next(name for name in PUBLIC if dotted.startswith(f"{name}."))
    return dotted.removeprefix(f"{module}.").partition(".")[0] in importlib.import_module(module).__all__


def docstrings_of(path: Path) -> list[str]:
    holders = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = (node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, holders))
    return [text for node in nodes if (text := ast.get_docstring(node))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page_names_only_public_paths(page: Path) -> None:
    text = ENTRY_POINTS.sub("", page.read_text(encoding="utf-8"))
    for command in COMMANDS:
        text = text.replace(f"python -m {command}", "")
    assert [dotted for dotted in DOTTED.findall(text) if not is_public(dotted)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page_imports_names_that_exist(page: Path) -> None:
    for module, names in IMPORT.findall(page.read_text(encoding="utf-8")):
        assert module in PUBLIC
        for name in filter(None, re.split(r"[,\s()]+", names)):
            assert hasattr(importlib.import_module(module), name), f"{module}.{name}"


@pytest.mark.slow
def test_docstrings_import_from_public_modules_alone() -> None:
    paths = [path for package in ("harness", "mmpf") for path in (ROOT / package).rglob("*.py")]
    imported = {module for path in paths for text in docstrings_of(path) for module, _ in IMPORT.findall(text)}
    assert imported <= set(PUBLIC)


@pytest.mark.parametrize("module", [harness, harness.plugins, mmpf], ids=lambda module: module.__name__)
def test_each_public_name_can_be_imported_and_no_other(module: object) -> None:
    names = module.__all__
    assert [name for name in names if not hasattr(module, name)] == []
    assert len(names) == len(set(names))
    assert not hasattr(module, "no_such_name")


def test_names_of_plug_ins_are_the_very_objects_of_the_modules_that_define_them() -> None:
    from harness.config.sensor import SensorSettings  # noqa: PLC0415
    from harness.scoring.metrics.registry import register  # noqa: PLC0415
    from mmpf.undetected.intensity import UnseenTraffic  # noqa: PLC0415

    assert harness.plugins.register_metric is register
    assert harness.plugins.SensorSettings is SensorSettings
    assert mmpf.UndetectedTraffic is UnseenTraffic


def loaded_after(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


HEAVY = {"libsumo", "matplotlib", "numba", "numpy", "pandas", "pydantic", "scipy", "sklearn", "typer"}


@pytest.mark.parametrize(
    ("statement", "unloaded"),
    [
        ("import harness.plugins, mmpf", HEAVY),
        ("from mmpf import Scan, Detections, Tracks, CONFIRMED, check_scan, highway", HEAVY - {"numpy"}),
        ("from mmpf import MixtureTracker", {"libsumo", "traci", "matplotlib", "harness"}),
        ("import harness; [getattr(harness, name) for name in harness.__all__]", {"libsumo", "matplotlib"}),
    ],
)
def test_nothing_heavy_is_loaded_before_it_is_needed(statement: str, unloaded: set[str]) -> None:
    assert not loaded_after(statement) & unloaded
