"""Make the reference tables, each by one command from a clean tree, or check them.

results/reference/tables.toml lists the tables. Finished runs are kept in results/making, so an interrupted table can
continue, and new seeds or trackers add only their own runs, unless the sources changed.

    python .ci/reference.py
    python .ci/reference.py trackers --workers 2
    python .ci/reference.py small --check
    python .ci/reference.py trackers --confirm

A change of code that changes no result needs no new table: `--confirm` makes some of its runs again. If every value is
the same, the table's manifest gets the code's present hashes, and how many runs show it.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import importlib
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
import typer
from reference_differences import TABLE, Difference, differences, row_differences

from harness.commands.from_options import typer_command, with_values
from harness.common.errors import InputError
from harness.common.files import replacing, write_text
from harness.config.options import checked, options_of
from harness.grid.options import GridOptions
from harness.grid.request import request_of
from harness.running.provenance import own_code
from harness.storage.manifest import CODE, RunFacts, manifest_of, write_manifest
from harness.storage.run_folder import COMPLETE, MANIFEST

ROOT = Path(__file__).parents[1]

FOLDER = Path("results") / "reference"
TABLES = FOLDER / "tables.toml"
KEYS = {"about", "command", "files", "some"}


@dataclass(frozen=True)
class Reference:
    """One reference table, or a folder of them.

    Attributes:
        name: Its name, and that of its folder.
        about: What it is for.
        words: The command that makes it, as words.
        files: Names of what is kept of it; empty keeps all tables, numbers and pictures.
        some: Words that, added to the command, let it make some of the runs; empty makes all.
    """

    name: str
    about: str
    words: tuple[str, ...]
    files: tuple[str, ...] = ()
    some: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command as it is typed."""
        return shlex.join(["python", "-m", "harness", *self.words])


def references(root: Path) -> dict[str, Reference]:
    """Return all references by name.

    Args:
        root: Top folder of the source tree.

    Raises:
        InputError: The list is missing or broken.
    """
    path = root / TABLES
    try:
        listed = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; restore it from the repository") from None
    return {name: _reference(name, entry, path) for name, entry in listed.items()}


def reference_named(name: str, root: Path) -> Reference:
    """Return a reference.

    Raises:
        InputError: There is none of that name.
    """
    known = references(root)
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        meant = f"do you mean {near[0]}?" if near else f"choose one of {', '.join(known)}"
        raise InputError(f"`name` {name}: no such reference; {meant}")
    return known[name]


def _reference(name: str, entry: object, path: Path) -> Reference:
    if not isinstance(entry, Mapping) or not entry.keys() <= KEYS or not {"about", "command"} <= entry.keys():
        raise InputError(f"{path}: [{name}] needs about and command, and may have files and some; nothing else")
    words = tuple(shlex.split(str(entry["command"])))
    if not words or any(word in ("--out", "--resume", "--quiet") for word in words):
        raise InputError(f"{path}: [{name}]: give a command without --out, --resume and --quiet; they are added")
    return Reference(
        name,
        str(entry["about"]),
        words,
        tuple(map(str, entry.get("files", ()))),
        tuple(shlex.split(str(entry.get("some", "")))),
    )


SOURCES = ("mmpf", "harness", "networks", "constraints.txt")
"""What results depend on; pages, tests and the list of references may change between the runs of a table."""


def changes(root: Path) -> list[str]:
    """Return what differs from the revision, untracked files too, apart from the references themselves."""
    lines = (_git(root, "status", "--porcelain", "--untracked-files=all") or "").splitlines()
    paths = [line[3:].split(" -> ")[-1] for line in lines]
    return [path for path in paths if not path.startswith(f"{FOLDER.as_posix()}/")]


def revision(root: Path) -> str:
    """Return the revision."""
    return (_git(root, "rev-parse", "HEAD") or "").strip()


def sources_of(root: Path) -> str:
    """Return a digest of all that results depend on, as it is committed."""
    trees = [_git(root, "rev-parse", f"HEAD:{name}") or "" for name in SOURCES]
    return hashlib.sha256("".join(trees).encode()).hexdigest()[:16]


def tracked(root: Path, folder: Path) -> set[Path]:
    """Return the files below a folder that the repository holds."""
    names = (_git(root, "ls-files", "-z", "--", str(folder)) or "").split("\0")
    return {root / name for name in names if name}


def _git(folder: Path, *words: str) -> str | None:
    """Return what git answers in a folder; None if it can't."""
    command = ["git", "-C", str(folder), *words]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout if answer.returncode == 0 else None


def told(found: list[Difference], committed: Path) -> str:
    """Return the differences in a paragraph, the first few of them, and on which machine the committed was made."""
    more = f"\n  and {len(found) - MOST_TOLD} more" if len(found) > MOST_TOLD else ""
    lines = "\n".join(f"  {each}" for each in found[:MOST_TOLD])
    made = _manifest(committed)
    on = f" (made on {made['machine'].get('processor')}, of {made.get('git_revision')})" if made else ""
    return f"{len(found)} values differ from {committed}{on}:\n{lines}{more}"


def made_here(folder: Path) -> bool:
    """Return whether a reference was made on a processor of this machine's kind."""
    made = _manifest(folder)
    return bool(made and made["machine"].get("kind") == processor_kind())


def _manifest(folder: Path) -> dict[str, Any] | None:
    """Return a folder's manifest; None where it is missing or tells no machine."""
    try:
        found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and isinstance(found.get("machine"), dict) else None


def processor_kind() -> str:
    """Return a digest of what the processor can do, by which libraries choose their kernels."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    told = {line.partition(":")[0].strip(): line.partition(":")[2].strip() for line in reversed(lines)}
    able = " ".join(sorted((told.get("flags") or told.get("Features") or "").split()))
    return hashlib.sha256(f"{told.get('model name')} {platform.machine()} {able}".encode()).hexdigest()[:16]


MAKING = Path("results") / "making"
MOST_TOLD = 5
KEPT = (".json", ".md", ".parquet", ".png", ".svg")
LEFT_OUT = ("runs",)
LINK_TO_PAGE = re.compile(r"\[[^\]]*\]\([^):]*\.html[^)]*\)")
"""A link to an HTML page beside a table: such pages are not kept."""

Execute = Callable[[list[str], Path], object]
"""Runs a command's words so that it writes into a folder; raises where it fails."""


def make_reference(reference: Reference, root: Path, execute: Execute) -> Path:
    """Make a reference and put it into the folder of references, over an earlier one.

    An interrupted one is taken up again, and one with more runs than before keeps those that there are.

    Args:
        reference: Which.
        root: Top folder of the source tree.
        execute: Runs its command.

    Returns:
        Its folder.

    Raises:
        InputError: The tree is not clean, or what was begun was begun with other sources.
    """
    changed = changes(root)
    if changed:
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        raise InputError(
            f"reference: references are made from a clean tree, but {changed[0]}{more} differ from the revision; "
            "commit or stash that first, or give `out` for a trial"
        )
    making = root / MAKING / reference.name
    _check_same_sources(making, sources_of(root))
    execute(list(reference.words), making)
    kept = root / FOLDER / reference.name
    files = keep(reference, making, kept)
    for file in tracked(root, kept) - files:
        file.unlink(missing_ok=True)
    if not (making / MANIFEST).is_file():  # a study leaves none
        write_manifest(kept / MANIFEST, RunFacts(COMPLETE, reference.command, 0, 0))
    _tell_command(kept, reference, revision(root))
    return kept


def keep(reference: Reference, made: Path, into: Path) -> set[Path]:
    """Copy what is kept of a reference, and return the copies."""
    copies = set()
    for file in sorted(made.rglob("*")):
        name = file.relative_to(made)
        wanted = name.as_posix() in reference.files if reference.files else file.suffix in KEPT
        hidden = any(part.startswith(".") for part in name.parts)
        if file.is_file() and wanted and not hidden and not set(name.parts[:-1]) & set(LEFT_OUT):
            (into / name).parent.mkdir(parents=True, exist_ok=True)
            with replacing(into / name) as temporary:
                shutil.copyfile(file, temporary)
                if file.suffix == ".md":
                    text = LINK_TO_PAGE.sub("not kept", file.read_text(encoding="utf-8"))
                    Path(temporary).write_text(text, encoding="utf-8")
            copies.add(into / name)
    return copies | {into / MANIFEST}


def _check_same_sources(making: Path, sources: str) -> None:
    """Refuse to go on with what other sources began; note which began what begins now."""
    note = making.with_name(f"{making.name}.sources")
    if making.exists():
        began = note.read_text(encoding="utf-8").strip() if note.is_file() else ""
        if began != sources:
            raise InputError(f"reference: {making} was begun with other sources; remove it to start again")
    making.parent.mkdir(parents=True, exist_ok=True)
    write_text(note, f"{sources}\n")


def _tell_command(kept: Path, reference: Reference, made_of: str) -> None:
    """Let the manifest name the one command that makes this."""
    path, command = kept / MANIFEST, f"python .ci/reference.py {reference.name}"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    # The sources were found unchanged; other references that wait to be committed are no change of theirs.
    manifest.setdefault("machine", {})["kind"] = processor_kind()
    manifest |= {"command": command, "that_runs": reference.command, "git_revision": made_of, CODE: own_code()}
    write_text(path, json.dumps(manifest, indent=2) + "\n")


def _typed(name: str, words: Sequence[str]) -> tuple[Any, list[str]]:
    """Return a command, and its words with the values of options that were typed without one."""
    function = importlib.import_module(f"harness.commands.{name}").command
    application = typer.Typer(add_completion=False)
    application.command()(typer_command(function))
    return typer.main.get_command(application), with_values(function, words)


def state_of(reference: Reference, root: Path) -> str:
    """Return in words whether a reference is there and made as the list says."""
    folder = root / FOLDER / reference.name
    if not folder.is_dir():
        return "not made yet"
    manifest = _manifest(folder) or {}
    made_of = manifest.get("git_revision", "an unknown revision")
    if again := manifest.get(CONFIRMED):
        made_of += f", {again['runs_made_again']} runs made again at {again['git_revision']} and the same"
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


def run_harness(
    words: Sequence[str], out: Path, workers: int | None = None, quiet: bool = False, tree: Path = ROOT
) -> None:
    """Run a command by a tree's code so that it writes into ``out``, which it takes up again where it can.

    Raises:
        InputError: The command fails.
    """
    known = options_of(importlib.import_module(f"harness.commands.{words[0]}").Options)
    added = ["--out", str(out)]
    added += ["--resume"] if "resume" in known and out.exists() else []
    added += ["--workers", str(workers or os.cpu_count() or 1)] if "workers" in known else []
    added += ["--quiet"] if quiet and "quiet" in known else []
    done = subprocess.run([sys.executable, "-m", "harness", *words, *added], check=False, cwd=tree)
    if done.returncode:
        raise InputError(f"reference: {shlex.join([*words, *added])} ended with exit code {done.returncode}")


def check(reference: Reference, execute: Execute) -> bool:
    """Make a reference elsewhere, print where it differs from the committed one, and return whether it does."""
    committed = ROOT / FOLDER / reference.name
    with tempfile.TemporaryDirectory() as made:
        execute(list(reference.words), Path(made) / reference.name)
        same_kind = made_here(committed)
        found = differences(committed, Path(made) / reference.name, not same_kind)
    same = "the same" if same_kind else "the same traffic and detections; scores belong to another kind of processor"
    typer.echo(told(found, committed) if found else f"{reference.name}: remade, and {same}", err=True)
    return bool(found)


CONFIRMED = "confirmed"


def confirm(reference: Reference, root: Path, execute: Execute, by_older: Execute | None = None) -> bool:
    """Make some runs of a reference again, note in its manifest if all are the same, and return whether any differs.

    Args:
        reference: Which.
        root: Top folder of the source tree.
        execute: Runs its command.
        by_older: Runs it by the code that made the reference: what that makes here is then compared with, in place of
            what it made on another kind of processor.

    Raises:
        InputError: The tree is not clean, the reference is missing, or without ``by_older`` it was made on another kind
            of processor.
    """
    committed = root / FOLDER / reference.name
    if changed := changes(root):
        raise InputError(f"`confirm`: {changed[0]} differs from the revision; commit that first")
    if by_older is None and not made_here(committed):
        raise InputError(
            f"`confirm`: {committed} is missing or made on another kind of processor; make it here, or give `against`"
        )
    with tempfile.TemporaryDirectory() as folder:
        made, before = Path(folder) / reference.name, committed
        if by_older is not None:
            before = Path(folder) / "before"
            by_older([*reference.words, *reference.some], before)
        execute([*reference.words, *reference.some], made)
        found = row_differences(before, made) if reference.some else differences(before, made)
        runs = sum(len(pd.read_parquet(path)) for path in made.rglob(TABLE))
    if found:
        typer.echo(told(found, committed), err=True)
        return True
    manifest = json.loads((committed / MANIFEST).read_text(encoding="utf-8"))
    confirmed = {"git_revision": revision(root), "runs_made_again": runs or "all"}
    confirmed |= {"processor_kind": processor_kind(), "made_again_as": " ".join(reference.some)} if by_older else {}
    manifest |= {CODE: own_code(), CONFIRMED: confirmed}
    write_text(committed / MANIFEST, json.dumps(manifest, indent=2) + "\n")
    typer.echo(f"{reference.name}: {runs or 'all'} runs made again, and the same", err=True)
    return False


def _check_made_by(reference: Reference, root: Path, tree: Path) -> None:
    """Refuse a tree whose code is not the one that made a reference."""
    if not (tree / "harness" / "__init__.py").is_file():
        raise InputError(f"`against` {tree}: no source tree of the harness; check out the table's revision there")
    ask = "import json; from harness.running.provenance import own_code; print(json.dumps(own_code()))"
    asked = subprocess.run([sys.executable, "-c", ask], cwd=tree, capture_output=True, text=True, check=False)
    if asked.returncode or json.loads(asked.stdout) != manifest_of(root / FOLDER / reference.name).get(CODE):
        raise InputError(f"`against` {tree}: its code is not the one that made {reference.name}")


def main(arguments: Sequence[str] | None = None) -> int:
    """List, make or check; return 1 where a check finds differences or, without a name, stale tables."""
    parser = argparse.ArgumentParser(prog="python .ci/reference.py", description="Make or check the reference tables.")
    parser.add_argument("name", nargs="?", help="name of a table, or all; without it, list all tables")
    parser.add_argument("--check", action="store_true", help="compare a remade table with the committed one")
    parser.add_argument("--confirm", action="store_true", help="make some runs again and note that they are the same")
    parser.add_argument("--against", type=Path, metavar="TREE", help="confirm by what the code of this tree makes here")
    parser.add_argument("--some", help="words that choose which runs `--against` makes, in place of the list's")
    parser.add_argument("--out", type=Path, help="trial: write to this folder and keep the committed table")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--quiet", action="store_true")
    chosen = parser.parse_args(arguments)

    if chosen.against is not None and not chosen.confirm:
        parser.error("`against` belongs to `--confirm`; give both")
    if chosen.some is not None and chosen.against is None:
        parser.error("`some` belongs to `--confirm --against TREE`; give all three")

    def execute(words: list[str], out: Path) -> None:
        run_harness(words, out, chosen.workers, chosen.quiet)

    def by_older(words: list[str], out: Path) -> None:
        run_harness(words, out, chosen.workers, chosen.quiet, chosen.against)

    try:
        listed = references(ROOT)
        if chosen.name is None:
            for each in listed.values():
                typer.echo(f"{each.name}: {each.about}\n  {state_of(each, ROOT)}\n  {each.command}")
            return int(chosen.check and any(stale_parts(each, ROOT) for each in listed.values()))
        wanted = listed.values() if chosen.name == "all" else [reference_named(chosen.name, ROOT)]
        differ = False
        for each in wanted:
            if chosen.check:
                differ |= check(each, execute)
            elif chosen.confirm and chosen.against is not None:
                _check_made_by(each, ROOT, chosen.against)
                some = each.some if chosen.some is None else tuple(shlex.split(chosen.some))
                differ |= confirm(replace(each, some=some), ROOT, execute, by_older)
            elif chosen.confirm:
                differ |= confirm(each, ROOT, execute)
            elif chosen.out is not None:
                execute(list(each.words), chosen.out.absolute())
            else:
                typer.echo(f"reference: {make_reference(each, ROOT, execute)}", err=True)
    except InputError as error:
        parser.error(str(error))
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
