"""Compares two runs or two grids of runs."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from harness.analysis import single
from harness.analysis.arms import TOLERATED_LOSS, Arms, measure, pair
from harness.analysis.coasting_ratio import RATIO_TOTALS
from harness.analysis.experiments import differing, differing_code, on_other_traffic
from harness.analysis.rules import PRIMARY, STEP_TIME, Rules, compared_quantities, name_of
from harness.analysis.sources import SETTING, Source
from harness.analysis.verdicts import NO_WORSE, TOO_FEW, UNDECIDED, UNTESTED, WORSE, Verdict, judge
from harness.analysis.why import Why
from harness.common.error_text import nearest
from harness.common.errors import InputError
from harness.common.numbers import without_nan
from harness.scoring.metrics.closedloop import PRIMARY as DRIVEN
from harness.scoring.metrics.hidden_cost import COST, CRPS, FALSE_HIDDEN
from harness.storage.grid_folder import column_of
from harness.storage.manifest import unproven
from harness.storage.run_folder import COMPLETE

WEIGHTS = (
    "Each run counts the same here, except in rates a kilometre, which are ratios of totals. A stress test's tables "
    "and curves weigh runs by their vehicle-steps or occlusions, so their means may differ."
)
HIDDEN = ("mae.hidden.lon_m", "mae.hidden.speed_mps")


@dataclass(frozen=True)
class Judgement:
    """A comparison of b with a.

    Attributes:
        verdicts: One for each tracker and metric.
        notes: What a reader must know beside.
        units: What the independent units of the verdicts are, in the plural.
        wanting: What b may not pass for beside single metrics, such as missing runs, a sentence each.
        why: What the failures of two single runs come from; None of grids.
        differing: Settings, code and models that differ, in words.
        paired: What is paired, or how many runs of each side the verdicts rest on, in words.
    """

    a: str
    b: str
    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]
    rules: Rules
    units: str = "seeds"
    wanting: tuple[str, ...] = ()
    why: Why | None = None
    differing: tuple[str, ...] = ()
    paired: str = ""

    @property
    def primary(self) -> tuple[Verdict, ...]:
        """The verdicts on metrics that are judged."""
        return tuple(verdict for verdict in self.verdicts if verdict.primary and verdict.verdict != UNTESTED)

    @property
    def regression(self) -> bool:
        """Whether anything that is judged is worse."""
        return any(verdict.regression for verdict in self.verdicts)

    @property
    def missing(self) -> tuple[str, ...]:
        """What is missing of both sides' runs, and of the metrics that were chosen, a sentence each."""
        if not self.primary:
            return (*self.wanting, "None of the metrics that are judged has values on both sides.")
        valueless = [each.metric for each in self.verdicts if each.primary and each.verdict == UNTESTED]
        unknown = [name_of(metric) for metric in valueless if self.rules.names(metric)]
        return (*self.wanting, *([f"Neither side has a value of {_some(unknown)}."] if unknown else []))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why nothing may be concluded, a sentence each; empty where something may be."""
        lacking: dict[str, list[str]] = {}
        for verdict in self.verdicts:
            if verdict.wanting not in ("", TOO_FEW) and (verdict.primary or not self.rules.are_chosen):
                lacking.setdefault(f"{verdict.label}: {verdict.wanting}", []).append(name_of(verdict.metric))
        of_metrics = [f"{why} ({_some(names)})." for why, names in lacking.items()]
        unsure = [each for each in self.verdicts if each.verdict == UNDECIDED and each.wanting in ("", TOO_FEW)]
        of_scatter = [self._more_needed(unsure)] if unsure else []
        return (*self.missing, *of_metrics, *of_scatter)

    @property
    def outcome(self) -> str:
        """The verdict over all: ``worse``, ``undecided`` or ``no worse``."""
        return WORSE if self.regression else UNDECIDED if self.reasons else NO_WORSE

    def as_table(self) -> dict[str, Any]:
        """Return everything as plain nested values."""
        told: dict[str, Any] = {"regression": self.regression, "outcome": self.outcome, "reasons": self.reasons}
        if self.why is not None:
            told["causes"] = self.why.counts()
        limits = {key: limit.model_dump() for key, limit in self.rules.limits.items()}
        told["rules"] = asdict(self.rules) | {"limits": limits}
        table: dict[str, Any] = without_nan(asdict(self) | told)
        return table

    def _more_needed(self, unsure: list[Verdict]) -> str:
        """Return how much more would decide what an interval leaves open."""
        few = [verdict for verdict in unsure if verdict.wanting]
        names = _some([name_of(verdict.metric) for verdict in few or unsure])
        told = f"Too few {self.units} for a verdict ({names})" if few else f"The intervals of {names} do not decide"
        known = [verdict.more_units for verdict in unsure if verdict.more_units is not None]
        if self.units == "vehicles":
            more = f"; about {max(known)} more would be needed" if len(known) == len(unsure) else ""
            return f"{told}{more}. Compare stress tests of several seeds."
        if len(known) < len(unsure):
            return f"{told}; add {self.units}." if few else f"{told}, and more {self.units} would hardly change that."
        count = max(known)
        more = f"{count} more {self.units if count > 1 else self.units.removesuffix('s')}"
        return f"{told}; about {more} would decide it with a probability of 80 %."


def compare(a: Source, b: Source, rules: Rules | None = None, allow_different: bool = False) -> Judgement:
    """Compare b with a.

    Runs on the same traffic (same settings and seed) are paired. Without common seeds, whole arms are compared, which
    needs larger differences. Two single runs on the same traffic are paired vehicle by vehicle.

    Args:
        rules: What is judged, and how much worse is put up with; None for the usual.
        allow_different: Whether different experiments are compared too, with what differs at the top.

    Raises:
        InputError: They are different experiments, have no tracker or no setting in common, or are single runs on
            different traffic.
    """
    closed_loop = _are_closed_loops(a, b)
    rules = _rules_for(closed_loop, rules or Rules())
    for side in (a, b):
        if not len(side.rows):
            raise InputError(f"compare: every run of {side.name} failed, so there is nothing to compare; run it again")
    differs = _differing(a, b, allow_different)
    told = [line for side in {a.folder: a, b.folder: b}.values() for line in unproven(side.folder, side.manifest)]
    if len(a.rows) == 1 and len(b.rows) == 1 and a.is_run and b.is_run:
        seen = single.read_seen(a, b)
        if unlike := single.seen_differently(*seen):
            _refuse_unless(allow_different, a, b, [_some(unlike)])
            differs = (_some(unlike), *differs)
        evidence = [single.evidence_of(side.folder, own) for side, own in zip((a, b), seen, strict=True)]
        singly, why = single.compare_runs(a, b, evidence, rules)
        verdicts = _with_values(judge(singly, rules))
        notes = (*told, *single.notes_of(a, b), *_guesses(verdicts))
        return Judgement(a.name, b.name, verdicts, notes, rules, "vehicles", (), why, differs, single.PAIRED)
    arms: list[Arms] = []
    wanting = _missing_runs(a, b)
    units, compared, other = "seeds", 0, 0
    for label, rows_a, rows_b in _matching_labels(a, b):
        pairing = pair(rows_a, rows_b, [*SETTING, *a.axes])
        units = pairing.units
        wanting += [f"{label}: {lacking}" for lacking in pairing.lacking]
        matched = rows_a.iloc[pairing.of_a], rows_b.iloc[pairing.of_b]
        compared += len(pairing.of_a)
        if pairing.layout.paired and (elsewhere := int(on_other_traffic(*matched).sum())):
            other += elsewhere
            pairing = replace(pairing, layout=replace(pairing.layout, paired=False))
        values = {
            quantity: [column_of(rows, quantity.key) for rows in matched]
            for quantity in compared_quantities(rules.primary, closed_loop)
            if rules.judges(quantity) or any(quantity.key in rows for rows in matched)
        }
        if _in_one_run(a, b) and pairing.layout.paired and all(STEP_TIME.key in rows for rows in matched):
            # As shares of those of a.
            of_a, of_b = (column_of(rows, STEP_TIME.key) for rows in matched)
            with np.errstate(divide="ignore", invalid="ignore"):
                values[STEP_TIME] = [of_a / of_a, of_b / of_a]
        for quantity, (of_a, of_b) in values.items():
            own = quantity.weight if quantity.is_counted and quantity.scale is None else ""
            total = RATIO_TOTALS.get(quantity.key, own)
            totals = (column_of(matched[0], total), column_of(matched[1], total)) if total else None
            arms.append(Arms(label, quantity, of_a, of_b, pairing.layout, totals))
    if not any(len(arm.a) and len(arm.b) for arm in arms):
        raise InputError(
            f"compare: {a.name} and {b.name} have no setting in common; compare grids of the same densities"
        )
    if other:
        _refuse_unless(allow_different, a, b, [f"the traffic or the detections of {other} of {compared} pairs"])
        differs = (f"traffic or detections of {other} of {compared} pairs, so that nothing is paired", *differs)
    measured = [measure(arm, 0.0 if rules.judges(arm.quantity) else TOLERATED_LOSS) for arm in arms]
    verdicts = _with_values(judge(measured, rules))
    if not all(arm.layout.paired for arm in arms):
        told.append("Nothing is paired: whole arms are compared, which shows only larger differences than pairs do.")
    if not (closed_loop or _in_one_run(a, b)):
        told.append(
            "The time of a step is not judged: it is comparable only between trackers of one and the same stress test."
        )
    told += [*([] if closed_loop else [WEIGHTS]), *_survivor_notes(verdicts)]
    wanting += _guesses(verdicts)
    paired = f"Compared: {compared} of the {len(a.rows)} runs of a with {compared} of the {len(b.rows)} runs of b."
    return Judgement(a.name, b.name, verdicts, tuple(told), rules, units, tuple(wanting), None, differs, paired)


def _differing(a: Source, b: Source, allow_different: bool) -> tuple[str, ...]:
    """Return sentences on what differs between two experiments, or raise an ``InputError`` if that is not allowed."""
    if _in_one_run(a, b):
        return ()
    world, trackers = differing(a.settings, b.settings)
    if world:
        _refuse_unless(allow_different, a, b, world)
    return (*world, *trackers, *differing_code(a.manifest, b.manifest))


def _refuse_unless(allowed: bool, a: Source, b: Source, what: list[str]) -> None:
    if not allowed:
        raise InputError(
            f"compare: {a.name} and {b.name} are different experiments ({'; '.join(what)}); make one like the other, "
            "or add `allow_different` to compare them all the same"
        )


def _are_closed_loops(a: Source, b: Source) -> bool:
    if a.is_closed_loop != b.is_closed_loop:
        drives, other = (a, b) if a.is_closed_loop else (b, a)
        raise InputError(
            f"compare: {drives.name} holds drives by belief, {other.name} runs in which SUMO drives; compare two alike"
        )
    return a.is_closed_loop


def _rules_for(closed_loop: bool, rules: Rules) -> Rules:
    """Return the rules, those of a closed loop naming its own metrics unless the user has named some."""
    rules = replace(rules, primary=DRIVEN) if closed_loop and rules.primary == PRIMARY else rules
    known = {quantity.key: quantity for quantity in compared_quantities(closed_loop=closed_loop)}
    for key in rules.primary:
        if key not in known:
            told = nearest(str(key), list(known), "`compare A B --json` lists those that are")
            option = "gate" if key in rules.limits else "primary"
            place = "" if ":" in str(key) else "MODULE:"
            own = f" (your own: `primary` {place}{key}, and its key alone in a gate file)"
            raise InputError(f"`{option}` {key}: no such metric is compared{own}{told}")
        rules.limit(known[key]).check(known[key])
    return rules


def _missing_runs(a: Source, b: Source) -> list[str]:
    """Return what of a has no counterpart in b that it should have: failed runs, and trackers that are gone."""
    missing = []
    for side, name in ((a, "a"), (b, "b")):
        if side.failed:
            missing.append(f"{side.failed} runs of {name} failed; make them again by --resume --retry-failed.")
        if side.manifest.get("status", COMPLETE) != COMPLETE:
            missing.append(f"{name} was not finished; make the rest by --resume.")
    gone = [label for label in a.labels if label not in b.labels]
    if gone and any(label in b.labels for label in a.labels):
        missing.append(
            f"b has no finished run of {', '.join(gone)}; choose one tracker by FOLDER@LABEL if that is meant."
        )
    return missing


def _matching_labels(a: Source, b: Source) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    if a.axes != b.axes:
        raise InputError(f"compare: {a.name} and {b.name} vary different settings; compare grids of the same settings")
    for side in (a, b):
        if missing := [axis for axis in side.axes if axis not in side.rows]:
            raise InputError(f"compare: {side.name} lacks the columns {', '.join(missing)}; make the grid again")
    common = [label for label in a.labels if label in b.labels]
    if not common and len(a.labels) == len(b.labels) == 1:
        yield single.label_of(a, b), a.rows, b.rows
    elif not common:
        raise InputError(
            f"compare: {a.name} and {b.name} have no tracker in common; choose one of each by FOLDER@LABEL, for "
            f"example '{a.folder}@{a.labels[0]}' '{b.folder}@{b.labels[0]}'"
        )
    for label in common:
        yield label, a.rows[a.rows["label"] == label], b.rows[b.rows["label"] == label]


def _with_values(verdicts: Iterable[Verdict]) -> tuple[Verdict, ...]:
    """Leave out metrics that neither side has a value of, unless they were to be judged."""
    return tuple(each for each in verdicts if each.primary or not (np.isnan(each.a) and np.isnan(each.b)))


def _in_one_run(a: Source, b: Source) -> bool:
    """Return whether the times of both sides were taken on one machine in one run."""
    return a.folder.resolve() == b.folder.resolve()


def _survivor_notes(verdicts: tuple[Verdict, ...]) -> list[str]:
    """Warn where the errors of hidden vehicles cover only those that a tracker kept."""
    fallen = {(each.label, each.metric) for each in verdicts if each.ci95[1] < 0.0}
    told = "hidden errors are over vehicles still followed; b follows fewer, so its smaller errors are no gain."
    smaller = {label for label, metric in fallen if metric in HIDDEN}
    return [f"{label}: {told}" for label in sorted(smaller) if (label, single.FOLLOWED) in fallen]


def _guesses(verdicts: tuple[Verdict, ...]) -> list[str]:
    """Return where a judged score of hidden vehicles falls while false hidden tracks, not judged, increase."""
    fallen = {each.label for each in verdicts if each.metric in (COST, CRPS) and each.primary and each.ci95[1] < 0.0}
    unjudged = [each for each in verdicts if each.metric == FALSE_HIDDEN and not each.primary]
    # Where its scatter is unknown, as in single runs, the difference alone counts.
    more = [each for each in unjudged if (each.difference if np.isnan(each.ci95[0]) else each.ci95[0]) > each.margin]
    told = "b's hidden cost or hidden CRPS is smaller, and it has more false hidden tracks: guesses lower both."
    return [f"{each.label}: {told}" for each in more if each.label in fallen]


def _some(names: list[str]) -> str:
    return f"{'; '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}"
