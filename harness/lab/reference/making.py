"""Makes a reference: where its command writes, whether that may be gone on with, and what of it is kept."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

from harness.common.errors import InputError
from harness.common.files import replacing, write_text
from harness.lab.reference.catalogue import FOLDER, Reference
from harness.lab.reference.differing import processor_kind
from harness.lab.reference.tree import changes, revision, sources_of, tracked
from harness.running.provenance import own_code
from harness.storage import run_folder as runfolder
from harness.storage.manifest import CODE, RunFacts, write_manifest

MAKING = Path("results") / "making"
KEPT = (".json", ".md", ".parquet", ".png", ".svg")
LEFT_OUT = ("runs",)

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
            copies.add(into / name)
    return copies | {into / runfolder.MANIFEST}


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
    """Let the manifest name the one command that makes this; a study leaves none of its own."""
    path = kept / runfolder.MANIFEST
    command = f"python -m harness reference {reference.name}"
    if not path.is_file():
        write_manifest(path, RunFacts(runfolder.COMPLETE, command, 0, 0))
    manifest = json.loads(path.read_text(encoding="utf-8"))
    # The sources were found unchanged; other references that wait to be committed are no change of theirs.
    manifest.setdefault("machine", {})["kind"] = processor_kind()
    manifest |= {"command": command, "that_runs": reference.command, "git_revision": made_of, CODE: own_code()}
    write_text(path, json.dumps(manifest, indent=2) + "\n")
