"""The metrics, registered under their keys in ``metrics.json`` with the quantities that they give."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from harness.common.numbers import without_nan
from harness.scoring.gathered import Evidence, gather
from harness.scoring.metrics import (
    calibration,
    conflicts,
    coverage,
    decisions,
    existence,
    gaps,
    gospa,
    hidden_by,
    hidden_cost,
    hidden_outcomes,
    in_plain_view,
    mae,
    manoeuvre,
    mot,
    motion,
    never_seen,
    occlusion,
    pseudo_occlusion,
    unseen_turns,
)
from harness.scoring.metrics.parts import InParts
from harness.scoring.metrics.quantity import Quantity
from harness.storage.schema import TABLES
from mmpf.registry import Registry

Score = Callable[[Evidence], Mapping[str, object]] | InParts[Any]


@dataclass(frozen=True)
class Metric:
    """A metric.

    Attributes:
        score: Returns its table of plain values; what has no rows behind it is nan or None, and never absent. An empty
            table says that the metric has no meaning on the run's road, and is left out.
        quantities: What people are told of its numbers.
    """

    score: Score
    quantities: tuple[Quantity, ...]


METRICS: Registry[Metric] = Registry("metric")


def register(name: str, *quantities: Quantity) -> Callable[[Score], Score]:
    """Return a decorator that makes a function a metric.

    Args:
        name: Key of its table in ``metrics.json``.
        quantities: What people are told of its numbers.

    Raises:
        ValueError: The name is taken, or a quantity is none of the metric's.
    """

    def file_under_name(score: Score) -> Score:
        for quantity in quantities:
            if not quantity.key.startswith(f"{name}."):
                raise ValueError(f"quantity {quantity.key!r} must begin with {name + '.'!r}, the metric's name")
        METRICS.register(name)(Metric(score, quantities))
        return score

    return file_under_name


register("hidden", *hidden_cost.QUANTITIES)(InParts(hidden_cost.measure_hidden, hidden_cost.cost_of_hidden))
register("mae", *mae.QUANTITIES)(InParts(mae.measure_errors, mae.mean_errors_by_visibility))
register("mot", *mot.IN_SIGHT)(InParts(mot.measure_in_sight, mot.multi_object_scores))
register("mot_all", *mot.REMEMBERED)(InParts(mot.measure_remembered, mot.multi_object_scores))
register("gospa", *gospa.IN_SIGHT)(InParts(gospa.measure_in_sight, gospa.gospa_of_steps))
register("gospa_remembered", *gospa.REMEMBERED)(InParts(gospa.measure_remembered, gospa.gospa_of_steps))
register("occlusion", *occlusion.QUANTITIES)(InParts(attrgetter("events"), occlusion.occlusion_outcomes))
register(in_plain_view.NAME, *in_plain_view.QUANTITIES)(
    InParts(in_plain_view.measure_plain_view, in_plain_view.scores_in_plain_view)
)
register("calibration", *calibration.QUANTITIES)(
    InParts(calibration.measure_calibration, calibration.calibration_by_visibility)
)
register(existence.NAME, *existence.QUANTITIES)(InParts(existence.measure_existence, existence.existence_calibration))
register("hidden_outcomes", *hidden_outcomes.QUANTITIES)(
    InParts(hidden_outcomes.measure_outcomes, hidden_outcomes.outcomes_while_hidden)
)
register(manoeuvre.NAME, *manoeuvre.QUANTITIES)(InParts(manoeuvre.measure_manoeuvres, manoeuvre.scores_by_manoeuvre))
register(motion.NAME, *motion.QUANTITIES)(InParts(motion.measure_motion, motion.quality_of_motion))
register("decisions", *decisions.QUANTITIES)(InParts(decisions.measure_decisions, decisions.decisions))
register("conflicts")(InParts(conflicts.measure_conflicts, conflicts.conflicts))
register(hidden_by.NAME, *hidden_by.QUANTITIES)(InParts(hidden_by.measure_causes, hidden_by.scores_by_cause))
register(unseen_turns.NAME, *unseen_turns.QUANTITIES)(InParts(unseen_turns.measure_turns, unseen_turns.scores_of_turns))
register(gaps.NAME, *gaps.QUANTITIES)(InParts(gaps.measure_gaps, gaps.scores_after_gaps))
register(pseudo_occlusion.NAME, *pseudo_occlusion.QUANTITIES)(
    InParts(pseudo_occlusion.measure_pseudo_occlusions, pseudo_occlusion.scores_of_pseudo_occlusions)
)
register(never_seen.NAME, *never_seen.QUANTITIES)(InParts(never_seen.measure_unseen, never_seen.scores_of_unseen))
register("coverage")(InParts(coverage.measure_coverage, coverage.coverage))
register("detection_noise")(InParts(coverage.measure_detection_noise, coverage.detection_noise))


_OWN = frozenset(METRICS)


def quantities() -> list[Quantity]:
    """Return the quantities of all metrics in the order of registration."""
    return [quantity for metric in METRICS.in_order().values() for quantity in metric.quantities]


def is_from_outside(quantity: Quantity) -> bool:
    """Return whether a quantity belongs to another package, so that its bounds are unknown."""
    return quantity.metric not in _OWN


def view(keys: Iterable[str], changed: Mapping[str, Mapping[str, Any]] = MappingProxyType({})) -> list[Quantity]:
    """Return what a table, chart or comparison shows: what it lists, then everything of metrics from outside.

    Args:
        keys: Keys of quantities in their order; a key that others begin with stands for all of these.
        changed: What this view names, rounds or weighs differently: fields of ``Quantity`` by key.
    """
    known = quantities()
    listed = [each for key in keys for each in known if f"{each.key}.".startswith(f"{key}.")]
    outside = [each for each in known if is_from_outside(each)]
    return [replace(each, **changed.get(each.key, {})) for each in (*listed, *outside)]


def score_metrics(evidence: Evidence) -> dict[str, Any]:
    """Return the table of every metric of a run that is one stretch; see ``Totals.metrics``."""
    totals = Totals(evidence.seed)
    totals.add(evidence)
    return totals.metrics()


@dataclass
class Totals:
    """The metrics of a run that comes stretch by stretch; see ``harness.scoring.metrics.parts``.

    Attributes:
        seed: Seed of the run, which intervals are drawn with.
    """

    seed: int
    _parts: dict[str, list[Any]] = field(default_factory=dict)
    _stretches: int = 0

    @staticmethod
    def whole_run_needed() -> bool:
        """Return whether a metric is registered that is not in parts, so that the run must be a single stretch."""
        return not all(isinstance(metric.score, InParts) for metric in METRICS.in_order().values())

    def add(self, evidence: Evidence) -> None:
        """Measure the next stretch.

        Raises:
            ValueError: It is a second one, and a metric needs the whole run.
        """
        if self._stretches and self.whole_run_needed():
            raise ValueError("a metric that is not in parts can't score a run stretch by stretch")
        self._stretches += 1
        for name, metric in METRICS.in_order().items():
            score = metric.score
            measured = score.measure(evidence) if isinstance(score, InParts) else score(evidence)
            self._parts.setdefault(name, []).append(measured)

    def metrics(self) -> dict[str, Any]:
        """Return the table of every metric under its key; nan becomes None."""
        tables: dict[str, Any] = {}
        for name, metric in METRICS.in_order().items():
            score, parts = metric.score, self._parts[name]
            rng = np.random.default_rng(self.seed)
            table = score.total(parts, rng) if isinstance(score, InParts) else parts[0]
            if table:
                tables[name] = without_nan(table)
        return tables


def completed(scores: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables by name, with null for every value of those metrics that are not among them."""
    if all(name in scores for name in METRICS):
        return dict(scores)
    names = ("truth.parquet", "detections.parquet", "tracks.parquet")
    truth, detections, tracks = (pd.DataFrame(columns=list(TABLES[name].needed)) for name in names)
    evidence = gather(truth, detections, tracks, 0)
    return {name: _nulled(table) for name, table in score_metrics(evidence).items()} | dict(scores)


def _nulled(value: object) -> Any:  # noqa: ANN401
    """Return nested tables with None for every value and no rows in any list."""
    if isinstance(value, Mapping):
        return {key: _nulled(item) for key, item in value.items()}
    return [] if isinstance(value, list) else None
