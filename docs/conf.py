"""How the site is built: ``python -m sphinx -W --keep-going -b html docs docs/_build``; needs the ``docs`` extra.

Nothing is fetched while it is built or read: no inventories of other projects, no web fonts, no scripts from elsewhere.
The examples are run, and a broken link, an unknown name or an example that raises fails the build.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HERE = Path(__file__).parent
REFERENCE = HERE.parent / "results" / "reference"

project = "MMPF harness"
author = "The MMPF harness developers"
project_copyright = f"{author}; BSD-3-Clause"
release = version = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "examples"]
templates_path: list[str] = []

# Blocks without a language show what commands print.
highlight_language = "none"

html_theme = "furo"
html_title = "MMPF harness"
html_static_path = ["static"]
html_css_files = ["tables.css"]
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False
html_show_sphinx = False

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("FloatArray", "IntArray", "BoolArray", "Step")}
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # the signature has them
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
add_module_names = False

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"exec_tracker\.py$",  # a program that reads scans
    "within_subsection_order": "ExampleTitleSortKey",
    "ignore_repr_types": r"matplotlib[text, axes]",
    "run_stale_examples": True,  # what they show depends on the packages too
    "download_all_examples": False,
    "write_computation_times": False,  # their page loads scripts from elsewhere
}


def _take_in_reference_results(_app: Sphinx) -> None:
    """Lay the committed results beside the pages, so that links to them lead somewhere in the site too."""
    site = HERE / "reference-results"
    shutil.rmtree(site, ignore_errors=True)
    for file in REFERENCE.rglob("*"):
        if file.suffix in {".md", ".png"}:
            copy = site / file.relative_to(REFERENCE)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


def _point_to_them(_app: Sphinx, page: str, source: list[str]) -> None:
    """Let links that are right in the repository be right in the site; of collisions no replays are kept.

    No line of a cell ends within an interval.
    """
    if page.startswith("reference-results/"):
        source[0] = re.sub(r"\[look\]\(kept/[^)]*\)", "-", source[0])
        source[0] = re.sub(r"(\[[-+\d.]+), (?=[-+\d.]+\])", "\\1,\N{NO-BREAK SPACE}", source[0])
    source[0] = source[0].replace("](../../results/reference/", "](../reference-results/")


def setup(app: Sphinx) -> None:
    """Register both."""
    app.connect("builder-inited", _take_in_reference_results, priority=100)
    app.connect("source-read", _point_to_them)
