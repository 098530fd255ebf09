"""The reference tables: listed, made, or held against those that are committed."""

from __future__ import annotations

import importlib
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typer

from harness.commands.from_options import typer_command, with_values
from harness.common.exit_codes import DONE, WORSE
from harness.config.options import checked, declared
from harness.grid.options import GridOptions
from harness.grid.request import request_of
from harness.lab.reference.catalogue import FOLDER, Reference, reference_named, references
from harness.lab.reference.differing import differences, made_here, told
from harness.lab.reference.making import make_reference
from harness.lab.reference.tree import top_of_tree
from harness.running.provenance import own_code
from harness.storage.manifest import CODE, manifest_of

ALL = "all"
"""Stands for every table in turn."""


def make_or_check(options: Mapping[str, Any]) -> int:
    """List the references, make one, or check one.

    Returns:
        Exit code: done, or worse where a check finds differences.

    Raises:
        InputError: There is no such reference, or the tree is not clean.
    """
    root, name = top_of_tree(), options["name"]
    if name is None:
        _list(root)
        return (
            WORSE if options["check"] and any(stale_parts(each, root) for each in references(root).values()) else DONE
        )
    if name == ALL:
        return max(make_or_check({**options, "name": each}) for each in references(root))
    reference = reference_named(name, root)

    def execute(words: list[str], out: Path) -> None:
        _execute(words, out, options["workers"], options["quiet"], root)

    if options["check"]:
        committed = root / FOLDER / name
        with tempfile.TemporaryDirectory() as made:
            execute(list(reference.words), Path(made) / name)
            same_kind = made_here(committed)
            found = differences(committed, Path(made) / name, not same_kind)
        same = (
            "the same" if same_kind else "the same traffic and detections; scores belong to another kind of processor"
        )
        typer.echo(told(found, committed) if found else f"{name}: remade, and {same}", err=True)
        return WORSE if found else DONE
    if options["out"] is not None:
        out = options["out"].absolute()
        execute(list(reference.words), out)
    else:
        out = make_reference(reference, root, execute)
    typer.echo(f"reference: {out}", err=True)
    return DONE


def _execute(words: list[str], out: Path, workers: int | None, quiet: bool, root: Path) -> None:
    """Run another command of this program so that it writes into ``out``, which it takes up again where it can."""
    known = declared(_table_of(words[0]))
    added = ["--out", str(out)]
    added += ["--resume"] if "resume" in known and out.exists() else []
    added += ["--workers", str(workers or os.cpu_count() or 1)] if "workers" in known else []
    added += ["--quiet"] if quiet and "quiet" in known else []
    called, typed = _typed(words[0], [*words[1:], *added])
    with chdir(root):
        called(args=typed, prog_name=f"python -m harness {words[0]}", standalone_mode=False)


def _typed(name: str, words: Sequence[str]) -> tuple[Any, list[str]]:
    """Return a command, and its words with the values of options that were typed without one."""
    function = importlib.import_module(f"harness.commands.{name}").command
    application = typer.Typer(add_completion=False)
    application.command()(typer_command(function))
    return typer.main.get_command(application), with_values(function, words)


def _table_of(name: str) -> Any:  # noqa: ANN401
    return importlib.import_module(f"harness.commands.{name}").Options


def _list(root: Path) -> None:
    """Print each reference with its state, what it is for and what it stands for."""
    for reference in references(root).values():
        typer.echo(f"{reference.name}: {reference.about}\n  {state_of(reference, root)}\n  {reference.command}")


def state_of(reference: Reference, root: Path) -> str:
    """Return in words whether a reference is there and made as the list says."""
    folder = root / FOLDER / reference.name
    if not folder.is_dir():
        return "not made yet"
    try:
        made_of = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["git_revision"]
    except (OSError, ValueError, KeyError):
        made_of = "an unknown revision"
    same, stale = made_as_listed(reference, folder), stale_parts(reference, root)
    older = f"; stale: {', '.join(stale)} changed since" if stale else ""
    return f"made of {made_of}{'' if same else ', with other options than these'}{older}"


def stale_parts(reference: Reference, root: Path) -> list[str]:
    """Return the packages whose code differs from the code that made a committed table; none of a table not made."""
    folder = root / FOLDER / reference.name
    if not folder.is_dir():
        return []
    made_by = manifest_of(folder).get(CODE) or {}
    return [part for part, digest in own_code().items() if made_by.get(part) != digest]


def made_as_listed(reference: Reference, folder: Path) -> bool:
    """Return whether a stress test's folder holds the grid that the list asks for; True of what is none."""
    if reference.words[0] != "stress":
        return True

    called, typed = _typed("stress", reference.words[1:])
    context = called.make_context("stress", typed)
    own = {name: value for name, value in context.params.items() if name in GridOptions.__annotations__}
    asked = json.loads(json.dumps(asdict(request_of(checked(GridOptions, own, "stress")))))
    made = json.loads((folder / "grid.json").read_text(encoding="utf-8"))
    # A grid of before knew fewer choices; what it does not name was as it is when it is not given.
    return all(made.get(key, value) == value for key, value in asked.items() if key != "replay")
