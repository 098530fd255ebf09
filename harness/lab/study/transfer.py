"""The transfer study: models trained on simulated and on real traffic, all tested on both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.lab.fidelity.samples import whole_recording
from harness.lab.fit.driver_fit import fit_follower, fit_short
from harness.lab.fit.rival_fit import fit_idm
from harness.lab.fit.unrolled import fit_residual
from harness.lab.study.study import COMPLETE, LABELS, score_row
from harness.lab.study.transfer_outcomes import (
    LEARNED,
    ON_BOTH,
    ON_NOTHING,
    ON_REAL,
    ON_SUMO,
    UNTRAINED,
    HeldOut,
    ModelComparison,
    TrainedModel,
    TransferOutcome,
    compare_transfer,
)
from harness.lab.windows.car_following import STEPS, CarFollowing, following_windows, join, load_following
from harness.lab.windows.cases import cases_of, following_cases
from harness.lab.windows.filtering import follow
from harness.lab.windows.pairs import EDGE_S, pair_windows, recording_of
from harness.lab.windows.realdata import pairs_file, snippet_files
from harness.lab.windows.recording import Scenario
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
from mmpf.motion.idm import intelligent_driver
from mmpf.motion.kinematic import process_noise
from mmpf.motion.learned.driver import LearnedDriver, with_follower, without_lane_changes
from mmpf.motion.learned.residual import ResidualFollower
from mmpf.motion.learned.short_driver import short_term_driver
from mmpf.motion.protocol import MotionModel, motion_models

COMPONENTS, SHORT_STEPS = 28, 51
PAIRS, SNIPPETS, SUMO = "real pairs", "real snippets", "sumo"
PREDICTIONS = 15 * 4
"""Models times tests: so often ``progress`` is called."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class TransferPlan:
    """The plan of the transfer study.

    Attributes:
        cases: Most simulated cases; of real windows all are taken.
        traffic_seeds: Number of its seeds, each of which drives every density.
        training_seeds: The same of the simulated training traffic for the models trained on both.
    """

    real_data: Path
    cases: int = 240
    particles: int = 200
    seed: int = 0
    first_traffic_seed: int = 0
    traffic_seeds: int = 2
    training_seeds: int = 1
    most_windows: int = 3000
    cache: Path | None = None


@dataclass(frozen=True)
class TransferResult:
    """All of the study's numbers; ``setting`` says how it was made."""

    outcomes: Sequence[TransferOutcome]
    comparisons: Sequence[ModelComparison]
    setting: Mapping[str, Any]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each model, test and horizon."""
        return [
            {
                "study": "transfer",
                "occlusion": COMPLETE,
                "model": outcome.model.name,
                "label": LABELS.get(outcome.model.name, "rival"),
                "trained_on": outcome.model.trained_on,
                "tested_on": test.tested_on,
                **score_row(outcome.scores, round(horizon_s / test.cases.step_s) - 1, horizon_s, test.vehicle),
                "vehicles": len(np.unique(test.vehicle)),
            }
            for outcome in self.outcomes
            for test in (outcome.test,)
            for horizon_s in test.horizons_s
        ]


def make_transfer_study(plan: TransferPlan, network: Network, say: Say, progress: Callable[[], None]) -> TransferResult:
    """Record, read, fit, predict and compare.

    Raises:
        InputError: Real recordings are missing or broken.
    """
    pairs_path, files = pairs_file(plan.real_data), snippet_files(plan.real_data)
    training, pairs = split_pairs(pair_windows(pairs_path, STEPS, STEP_S), plan.seed)
    tests = [
        held_out(PAIRS, pairs, HORIZONS_S),
        held_out(SNIPPETS, snippet_windows(files, SHORT_STEPS, say), tuple(h for h in HORIZONS_S if h <= 5.0)),
        held_out(SNIPPETS, snippet_windows(files, STEPS, say), tuple(h for h in HORIZONS_S if h > 5.0)),
    ]
    reporting = scenarios(plan.first_traffic_seed, plan.traffic_seeds, REPORTING_DURATION_S)
    windows = _simulated_windows(reporting, plan, network, say)
    simulated = following_cases(windows, plan.cases, STEP_S, np.random.default_rng([plan.seed, 0]))
    tests.append(HeldOut(SUMO, simulated, np.arange(simulated.count), HORIZONS_S))
    for_training = scenarios(FIRST_TRAINING_SEED, plan.training_seeds, TRAINING_DURATION_S)
    both = mixed(_simulated_windows(for_training, plan, network, say), training, plan.most_windows, plan.seed)
    models = [
        *(TrainedModel(name, ON_SUMO, _lane_keeping(motion_models[name]())) for name in LEARNED),
        *fitted_models(training, ON_REAL, plan.seed, say),
        *fitted_models(both, ON_BOTH, plan.seed, say),
        *(TrainedModel(name, ON_NOTHING, motion_models[name]()) for name in UNTRAINED),
    ]
    models.sort(key=lambda model: (*LEARNED, *UNTRAINED).index(model.name))
    outcomes = []
    for _, of_one_traffic in groupby(tests, lambda test: test.tested_on):
        parts = list(of_one_traffic)
        for model in models:
            for test in parts:
                clouds = follow(model.model, test.cases, plan.particles, np.random.default_rng([plan.seed, 2]))
                outcomes.append(TransferOutcome(model, test, score(clouds, test.cases)))
                progress()
    return TransferResult(outcomes, compare_transfer(outcomes), _setting(plan, network, tests, training, both))


def fitted_models(windows: CarFollowing, trained_on: str, seed: int, say: Say) -> list[TrainedModel]:
    """Fit every learned kind of model to the same windows with leaders.

    Of ``gmm`` the following mixture and the drivers' habits are fitted, of ``residual`` the network; driving without a
    leader and motion across the lane, in which pairs give no samples and which touch no longitudinal error here, remain
    the committed ones.
    """
    say(f"{trained_on}: {len(windows)} windows of 10 s")
    follower = fit_follower(windows, COMPONENTS, seed, STEP_S, say)
    learned = with_follower(follower, "gmm")
    say(f"{trained_on}: fitting residual")
    network = fit_residual(windows, seed, say)
    say(f"{trained_on}: fitting gmm-short")
    short = short_term_driver(fit_short(windows, COMPONENTS, seed))
    say(f"{trained_on}: fitting idm")
    # The fit takes one window of each vehicle; here it is to take all.
    parameters = fit_idm(replace(windows, vehicle=np.arange(len(windows))), seed, STEP_S)
    driver = intelligent_driver(parameters, process_noise("idm-fitted"), "idm-fitted")
    models: tuple[MotionModel, ...] = (
        *(_lane_keeping(with_follower(ResidualFollower(network), "residual")), _lane_keeping(learned)),
        *(short, driver),
    )
    return [TrainedModel(name, trained_on, model) for name, model in zip(LEARNED, models, strict=True)]


def _lane_keeping(model: MotionModel) -> MotionModel:
    return without_lane_changes(model) if isinstance(model, LearnedDriver) else model


def split_pairs(windows: CarFollowing, seed: int) -> tuple[CarFollowing, CarFollowing]:
    """Return the windows of one half of the pairs for training, and those of the other half for the test.

    Raises:
        InputError: There are fewer than four pairs.
    """
    pairs = np.unique(windows.vehicle)
    if len(pairs) < 4:
        raise InputError(
            f"the table of pairs gives {len(pairs)} pairs with 10 s of car following; at least 4 are needed"
        )
    chosen = np.random.default_rng([seed, 3]).permutation(pairs)[: len(pairs) // 2]
    trains = np.isin(windows.vehicle, chosen)
    return windows.take(np.flatnonzero(trains)), windows.take(np.flatnonzero(~trains))


def mixed(simulated: CarFollowing, real: CarFollowing, most: int, seed: int) -> CarFollowing:
    """Return as many simulated as real windows, at most ``most`` of either; real ones come several times."""
    count = min(most, len(simulated))
    chosen = np.random.default_rng([seed, 4]).choice(len(simulated), size=count, replace=False)
    return join([simulated.take(np.sort(chosen)), real.take(np.resize(np.arange(len(real)), count))])


def snippet_windows(files: Sequence[Path], steps: int, say: Say) -> CarFollowing:
    """Cut windows from files of recorded traffic; a line for each file says how many vehicles gave any.

    Raises:
        InputError: A file can't be read, or there is no window in any.
    """
    parts = []
    for path in files:
        traffic = whole_recording(path)
        windows = following_windows(recording_of(traffic), traffic.road, steps, STEP_S)
        led = windows.take(np.flatnonzero(windows.has_leader))
        say(
            f"{path.name}: {traffic.counts.vehicles_kept} vehicles, of which {len(np.unique(led.vehicle))} follow a "
            f"leader for {(steps - 1) * STEP_S:g} s without a lane change near: {len(led)} windows"
        )
        parts.append(led)
    found = join(parts)
    if not len(found):
        raise InputError(f"no recording has a vehicle that follows another for {(steps - 1) * STEP_S:g} s")
    return found


def held_out(tested_on: str, windows: CarFollowing, horizons_s: tuple[float, ...]) -> HeldOut:
    """Return windows as a test; every window is a case."""
    return HeldOut(tested_on, cases_of(windows, STEP_S), windows.vehicle, horizons_s)


def _simulated_windows(wanted: Sequence[Scenario], plan: TransferPlan, network: Network, say: Say) -> CarFollowing:
    windows = load_following(record_scenarios(network, wanted, plan.cache, say), network.road)
    return windows.take(np.flatnonzero(windows.has_leader))


def _setting(
    plan: TransferPlan, network: Network, tests: Sequence[HeldOut], training: CarFollowing, both: CarFollowing
) -> dict[str, Any]:
    tested: dict[str, str] = {}
    for test in tests:
        windows = (
            f"{test.cases.count} windows of {len(np.unique(test.vehicle))} vehicles for "
            f"{', '.join(f'{horizon:g}' for horizon in test.horizons_s)} s"
        )
        tested[test.tested_on] = " and ".join(filter(None, (tested.get(test.tested_on), windows)))
    return {
        "network": network.name,
        "tested_on": tested,
        "simulated_test_seeds": f"{plan.first_traffic_seed} to {plan.first_traffic_seed + plan.traffic_seeds - 1}",
        "real_training": f"{len(training)} windows of {len(np.unique(training.vehicle))} pairs",
        "left_out_at_both_ends_of_a_pair": f"{EDGE_S:g} s, where the source's smoothing swings in",
        "training_on_both": f"{len(both)} windows, half of them real, each real one repeated; simulated ones of seeds "
        f"{FIRST_TRAINING_SEED} to {FIRST_TRAINING_SEED + plan.training_seeds - 1}",
        "components": COMPONENTS,
        "particles": plan.particles,
        "seed": plan.seed,
        "start": "true state",
        "leader": "true",
        "intervals": "95 %, bootstrap over vehicles",
    }
