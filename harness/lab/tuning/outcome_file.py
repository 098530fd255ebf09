"""The file of tuned settings: each tracker's best one, how it was found, and everything that was tried."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.common.files import write_text
from harness.lab.tuning.spaces import DEFAULTS_IN_CODE, Range
from harness.lab.tuning.trials import OBJECTIVE, Found, Trial


@dataclass(frozen=True)
class Outcome:
    """A search and what it was made on.

    Attributes:
        tracker: Name of the tracker.
        command: What makes it again.
        recordings: What every setting was tried on, a table for each.
        found: What the search has come to.
    """

    tracker: str
    command: str
    recordings: Sequence[Mapping[str, object]]
    found: Found


def write_outcome(outcome: Outcome, path: Path) -> None:
    """Put a search and its best setting into the file of tuned settings; other trackers' entries stay.

    Args:
        outcome: The search.
        path: The TOML file.
    """
    lines = [*_other_tables(path, outcome.tracker), *_table(outcome)]
    write_text(path, "\n".join(lines).rstrip() + "\n")


def _table(outcome: Outcome) -> list[str]:
    found = outcome.found
    best, first = found.best, found.trials[0]
    scores = {name: getattr(best.scores, name) for name in best.scores.names()}
    ranges = {
        key: [values.low, values.high] if isinstance(values, Range) else list(values)
        for key, values in found.space.items()
    }
    # What a tracker takes from here is called options; what its code holds by itself is only told of.
    options = "found" if outcome.tracker in DEFAULTS_IN_CODE else "options"
    return [
        f"[{outcome.tracker}]",
        f"command = {json.dumps(outcome.command)}",
        f"budget = {len(found.trials)}",
        f"objective_is = {json.dumps(OBJECTIVE)}",
        *([] if first.refused else [f"objective_before = {first.objective:.3f}"]),
        f"objective = {best.objective:.3f}",
        *(f"{name} = {value:.3f}" for name, value in scores.items() if math.isfinite(value)),
        f"at_an_end = {json.dumps(sorted(found.at_an_end))}",
        f"searched = {_inline(ranges)}",
        "recordings = [",
        *(f"  {_inline(entry)}," for entry in outcome.recordings),
        "]",
        "trials = [",
        *(f"  {_inline(_told(trial))}," for trial in found.trials),
        "]",
        "",
        f"[{outcome.tracker}.{options}]",
        *(_assignments(best.options)),
        "",
    ]


def _told(trial: Trial) -> dict[str, object]:
    if trial.refused:
        return {"refused": trial.refused, **trial.options}
    stopped = {"stopped_after": trial.batches} if trial.stopped else {}
    return {"objective": round(trial.objective, 3), **stopped, **trial.options}


def _assignments(table: Mapping[str, object]) -> list[str]:
    return [f"{name} = {json.dumps(value)}" for name, value in table.items()]


def _inline(entry: Mapping[str, object]) -> str:
    return "{ " + ", ".join(_assignments(entry)) + " }"


def _other_tables(path: Path, replaced: str) -> list[str]:
    kept, keep = [], True
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        if line.startswith("["):
            keep = line.strip("[]").partition(".")[0] != replaced
        if keep:
            kept.append(line)
    return [*kept, ""] if kept and kept[-1] else kept
