"""A resumed command of a single run: the finished run in its folder is kept if it is the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.config.layers import config_from_table, leaves
from harness.config.model import RunConfig
from harness.running.open import OpenSnapshots
from harness.running.provenance import provenance_of
from harness.storage import run_folder as runfolder
from harness.storage.manifest import CODE, INPUTS, check_unedited


def kept_metrics(
    config: RunConfig, out: Path, open_snapshots: OpenSnapshots, tell: Callable[[str], object]
) -> dict[str, Any] | None:
    """Return the metrics of the finished run in a folder, or None if there is none and it has to be made.

    A run that was interrupted begins anew, since neither a simulator nor a tracker can go on in the middle.

    Args:
        out: The folder.
        open_snapshots: Opens the traffic, whose files are compared with those of the run.
        tell: Called with a sentence on what is kept.

    Raises:
        InputError: It did not end, was edited, or has other settings, code, models or input files.
    """
    if not out.exists():
        left = out.with_name(out.name + runfolder.INCOMPLETE_SUFFIX)
        interrupted = f"; the steps in {left} can't be continued and stay there" if left.is_dir() else ""
        tell(f"nothing is kept: there is no finished run in {out}{interrupted}")
        return None
    manifest = runfolder.read_manifest(out, "out")
    check_unedited(out, manifest, "out")
    before = dict(leaves(config_from_table(runfolder.read_config_table(out, "out")).model_dump()))
    now = dict(leaves(config.model_dump()))
    differs = [f"{key} {before.get(key)} there, {now.get(key)} now" for key in now if before.get(key) != now[key]]
    code, models = provenance_of([config])
    snapshots = open_snapshots(config)
    snapshots.close()
    for noted, found in ((manifest.get(CODE) or {}, code), (manifest.get(INPUTS) or {}, snapshots.hashes() | models)):
        differs += [f"{name} has changed" for name in found if noted.get(name) != found[name]]
    if differs:
        raise InputError(
            f"`resume`: the run in {out} is another one ({'; '.join(differs)}); choose another `out`, or replace it by "
            "`force` without `resume`"
        )
    tell(f"the {manifest['steps']} steps in {out} are kept, nothing is made")
    return runfolder.read_metrics(out, "out")
