"""The transfer study from plan to numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.lab.study.study import COMPLETE, LABELS, score_row
from harness.lab.study.transfer.models import (
    COMPONENTS,
    ON_BOTH,
    ON_NOTHING,
    ON_REAL,
    ON_SUMO,
    TrainedModel,
    committed_models,
    fitted_models,
    input_rows,
)
from harness.lab.study.transfer.training_sets import (
    PAIRS,
    SHORT_STEPS,
    SNIPPETS,
    SUMO,
    HeldOutPart,
    HeldOutSet,
    Say,
    held_out_set,
    mixed,
    snippet_windows,
    split_pairs,
)
from harness.lab.study.transfer.verdicts import Comparison, Outcome, Trend, compare_transfer
from harness.lab.windows.car_following import STEPS, Following, load_following
from harness.lab.windows.cases import Cases, following_cases
from harness.lab.windows.filtering import Cloud, follow
from harness.lab.windows.pairs import EDGE_S, pair_windows
from harness.lab.windows.realdata import pairs_file, snippet_files
from harness.lab.windows.scenarios import (
    FIRST_TRAINING_SEED,
    REPORTING_DURATION_S,
    TRAINING_DURATION_S,
    record_scenarios,
    scenarios,
)
from harness.lab.windows.scores import HORIZONS_S, score
from harness.truth.frame import STEP_S
from harness.truth.network.network import Network
from mmpf.motion.state import ACCEL, LON

STUDY = "transfer"
MODELS = 12
TEST_SETS = 3
"""Processor time of all fits."""
UP_TO_5_S = tuple(horizon for horizon in HORIZONS_S if horizon <= 5.0)
BEYOND_5_S = tuple(horizon for horizon in HORIZONS_S if horizon > 5.0)


@dataclass(frozen=True)
class TransferPlan:
    """What the study is to be made of.

    Attributes:
        real_data: Folder of real recordings.
        cases: Most simulated cases; of real windows all are taken.
        particles: Particles per case.
        seed: Seed of the split of the pairs, the fits and the particles.
        first_traffic_seed: First seed of the simulated test traffic.
        recordings: Recordings of it.
        training_recordings: Recordings of simulated training traffic for the models trained on both.
        most_windows: Most windows of either kind that those are trained on.
        cache: Folder of the recordings; none for the usual one.
    """

    real_data: Path
    cases: int = 240
    particles: int = 200
    seed: int = 0
    first_traffic_seed: int = 0
    recordings: int = 16
    training_recordings: int = 8
    most_windows: int = 3000
    cache: Path | None = None


@dataclass(frozen=True)
class TransferResult:
    """All of the study's numbers.

    Attributes:
        outcomes: In the order of the table.
        rows: What ``results.json`` holds under ``results``.
        inputs: How the test traffic lies in the ranges that the learned drivers were trained on.
        comparisons: The models trained on simulated traffic held against the others.
        setting: How the study was made.
    """

    outcomes: Sequence[Outcome]
    rows: Sequence[Mapping[str, Any]]
    inputs: Sequence[Mapping[str, Any]]
    comparisons: Sequence[Comparison]
    setting: Mapping[str, Any]


def make_transfer_study(plan: TransferPlan, network: Network, say: Say, progress: Callable[[], None]) -> TransferResult:
    """Record, read, fit, predict and compare.

    Args:
        plan: What to do.
        network: Where the simulated traffic runs.
        say: Told one line a stage.
        progress: Called after each model and test set.

    Raises:
        InputError: Real recordings are missing or broken.
    """
    pairs_path, files = pairs_file(plan.real_data), snippet_files(plan.real_data)
    training, held_out = split_pairs(pair_windows(pairs_path, STEPS, STEP_S), plan.seed)
    sets = [
        held_out_set(PAIRS, [(held_out, HORIZONS_S)]),
        held_out_set(
            SNIPPETS,
            [
                (snippet_windows(files, SHORT_STEPS, say), UP_TO_5_S),
                (snippet_windows(files, STEPS, say), BEYOND_5_S),
            ],
        ),
        _simulated_set(plan, network, say),
    ]
    for_training = scenarios(FIRST_TRAINING_SEED, plan.training_recordings, TRAINING_DURATION_S)
    simulated = _simulated_windows(for_training, plan, network, say)
    both = mixed(simulated, training, plan.most_windows, plan.seed)
    models = [
        *committed_models(),
        *fitted_models(training, ON_REAL, plan.seed, say),
        *fitted_models(both, ON_BOTH, plan.seed, say),
    ]
    outcomes = []
    for tested in sets:
        for model in _in_order(models):
            outcomes += [_outcome(model, tested.name, part, plan) for part in tested.parts]
            progress()
    return TransferResult(
        outcomes,
        [row for outcome in outcomes for row in _rows(outcome)],
        [row for tested in sets for row in input_rows(models, tested)],
        compare_transfer(outcomes),
        _setting(plan, network, sets, training, both),
    )


def _in_order(models: Sequence[TrainedModel]) -> list[TrainedModel]:
    """Return the models by kind, what each was trained on side by side."""
    kinds = list(dict.fromkeys(model.name for model in models))
    trainings = (ON_SUMO, ON_REAL, ON_BOTH, ON_NOTHING)
    return sorted(models, key=lambda model: (kinds.index(model.name), trainings.index(model.trained_on)))


def _outcome(model: TrainedModel, tested_on: str, part: HeldOutPart, plan: TransferPlan) -> Outcome:
    trend: list[tuple[float, float, float]] = []
    clouds = follow(model.model, part.cases, plan.particles, np.random.default_rng([plan.seed, 2]))
    scores = score(_keeping_trend(clouds, part.cases, trend), part.cases)
    return Outcome(model, tested_on, part, scores, Trend(*np.array(trend).T))


def _keeping_trend(clouds: Iterator[Cloud], cases: Cases, kept: list[tuple[float, float, float]]) -> Iterator[Cloud]:
    start = cases.truth[0, ACCEL]
    for cloud in clouds:
        lon_m, accel = ((cloud.weight * cloud.state[row]).sum(axis=1) for row in (LON, ACCEL))
        true_accel = cases.truth[cloud.step, ACCEL]
        bias = float((lon_m - cases.truth[cloud.step, LON]).mean())
        share, true_share = (float(start @ after) / max(float(start @ start), 1e-9) for after in (accel, true_accel))
        kept.append((bias, share, true_share))
        yield cloud


def _rows(outcome: Outcome) -> list[dict[str, Any]]:
    model, part = outcome.model, outcome.part
    head = {
        "study": STUDY,
        "occlusion": COMPLETE,
        "model": model.name,
        "label": LABELS.get(model.name, "rival"),
        "trained_on": model.trained_on,
        "tested_on": outcome.tested_on,
    }
    vehicles = len(np.unique(part.vehicle))
    rows = []
    for horizon in part.horizons_s:
        step = round(horizon / part.cases.step_s) - 1
        row = score_row(outcome.scores, step, horizon, part.vehicle)
        trend = {
            "lon_bias_m": float(outcome.trend.bias_m[step]),
            "accel_kept": float(outcome.trend.accel_kept[step]),
            "accel_kept_true": float(outcome.trend.accel_kept_true[step]),
        }
        rows.append({**head, **row, **trend, "vehicles": vehicles})
    return rows


def _simulated_set(plan: TransferPlan, network: Network, say: Say) -> HeldOutSet:
    wanted = scenarios(plan.first_traffic_seed, plan.recordings, REPORTING_DURATION_S)
    windows = _simulated_windows(wanted, plan, network, say)
    cases = following_cases(windows, plan.cases, STEP_S, np.random.default_rng([plan.seed, 0]))
    return HeldOutSet(SUMO, (HeldOutPart(cases, np.arange(cases.count), HORIZONS_S),), windows)


def _simulated_windows(wanted: Sequence[Any], plan: TransferPlan, network: Network, say: Say) -> Following:
    windows = load_following(record_scenarios(network, wanted, plan.cache, say), network.road)
    return windows.take(np.flatnonzero(windows.has_leader))


def _setting(
    plan: TransferPlan, network: Network, sets: Sequence[HeldOutSet], training: Following, both: Following
) -> dict[str, Any]:
    tested = {
        tested.name: " and ".join(
            f"{part.cases.count} windows of {len(np.unique(part.vehicle))} vehicles for "
            f"{', '.join(f'{horizon:g}' for horizon in part.horizons_s)} s"
            for part in tested.parts
        )
        for tested in sets
    }
    last = plan.first_traffic_seed + plan.recordings - 1
    return {
        "network": network.name,
        "tested_on": tested,
        "simulated_test_seeds": f"{plan.first_traffic_seed} to {last}",
        "real_training": f"{len(training)} windows of {len(np.unique(training.vehicle))} pairs",
        "left_out_at_both_ends_of_a_pair": f"{EDGE_S:g} s, where the source's smoothing swings in",
        "training_on_both": f"{len(both)} windows, half of them real, each real one repeated; simulated ones of seeds "
        f"{FIRST_TRAINING_SEED} to {FIRST_TRAINING_SEED + plan.training_recordings - 1}",
        "components": COMPONENTS,
        "particles": plan.particles,
        "seed": plan.seed,
        "start": "true state",
        "leader": "true",
        "intervals": "95 %, bootstrap over vehicles",
    }
