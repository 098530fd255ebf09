"""Trains models from traffic to model files and cards."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import numpy as np

from harness.common.errors import InputError
from harness.common.files import replacing
from harness.lab.fit import change_fit, driver_fit, recurrent_fit, unrolled
from harness.lab.fit.card import TRAFFIC, errors_by_regime, write_card
from harness.lab.fit.change_fit import SCATTERED_SHARE, change_samples
from harness.lab.fit.mixture_em import START_SAMPLES, fit_mixture
from harness.lab.fit.rival_fit import fit_adaptive, fit_idm, fit_noise, write_rivals
from harness.lab.windows import recording
from harness.lab.windows.car_following import STEPS, CarFollowing, load_following
from harness.lab.windows.cases import cases_of, lane_change_cases
from harness.lab.windows.changing import LaneChanges, changes_to_one_side_per_s, load_changes
from harness.lab.windows.recording import HELD_OUT_SEEDS
from harness.truth.network.network import Network
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.learned import empirical, recurrent, residual
from mmpf.motion.learned.driver import LearnedDriver, load_learned_driver, save_driver, with_follower
from mmpf.motion.learned.follower import Follower
from mmpf.motion.learned.lane_changer import CHANGE
from mmpf.motion.learned.network_file import save_network
from mmpf.motion.learned.short_driver import SHORT, short_term_driver
from mmpf.motion.learned.trial import check_that_it_drives

LANE_KEEPING, LANE_CHANGE = "lane-keeping", "lane-change"
RESIDUAL, RECURRENT, EMPIRICAL = residual.CASE, recurrent.CASE, empirical.CASE
PAPER_COMPONENTS = {LANE_KEEPING: 28, LANE_CHANGE: 60}
CASES = (*PAPER_COMPONENTS, RESIDUAL, RECURRENT, EMPIRICAL)
HELD_OUT_SAMPLES = 20_000

Say = Callable[[str], None]


@dataclass(frozen=True)
class TrainingPlan:
    """What is to be trained.

    Attributes:
        case: One of ``CASES``.
        traffic: Seeds of the traffic to train on.
        densities: Vehicles per kilometre and lane at which each seed is recorded, for held-out traffic too.
        duration_s: Length of each recording to train on.
    """

    case: str
    components: int | None
    traffic: range
    seed: int
    cache: Path | None
    out: Path
    densities: tuple[float, ...] = recording.DENSITIES_VEH_PER_KM_LANE
    duration_s: float = recording.TRAINING_DURATION_S

    @property
    def size(self) -> int:
        """Number of components."""
        return self.components or PAPER_COMPONENTS[self.case]


def train(plan: TrainingPlan, network: Network, say: Say) -> list[Path]:
    """Record what is not recorded yet, fit, score on held-out seeds, and write model files and cards.

    Raises:
        InputError: An unknown case, or too little traffic.
    """
    if plan.case not in CASES:
        raise InputError(f"`case` {plan.case}: no such case; give {', '.join(CASES)} or turning")
    training, tuning = (
        recording.record_traffic(network, seeds, duration_s, plan.cache, say, plan.densities)
        for seeds, duration_s in ((plan.traffic, plan.duration_s), (HELD_OUT_SEEDS, recording.TUNING_DURATION_S))
    )
    with TemporaryDirectory(prefix="harness-train-") as folder:
        made = _train(replace(plan, out=Path(folder)), network, training, tuning, say)
        plan.out.mkdir(parents=True, exist_ok=True)
        for path in sorted(Path(folder).iterdir()):
            with replacing(plan.out / path.name) as temporary:
                copyfile(path, temporary)
    return [plan.out / path.name for path in made]


def _train(
    plan: TrainingPlan, network: Network, training: Sequence[Path], tuning: Sequence[Path], say: Say
) -> list[Path]:
    if plan.case == LANE_CHANGE:
        changes, held_changes = (load_changes(paths, network.road) for paths in (training, tuning))
        return _train_change(plan, network, changes, held_changes, say)
    windows, held_out = (load_following(paths, network.road) for paths in (training, tuning))
    if (count := len(windows.led)) < (plan.size if plan.case in PAPER_COMPONENTS else 1):
        raise InputError(f"`seeds`: {count} windows of car following are too few to train on; give more seeds")
    if plan.case not in PAPER_COMPONENTS:
        return _train_follower(plan, network, windows, held_out, say)
    say("fitting the rivals' parameters and noise")
    held_changes = load_changes(tuning, network.road)
    every_change = lane_change_cases(held_changes, len(held_changes), np.random.default_rng(plan.seed))
    driver, adaptive = fit_idm(windows, plan.seed), fit_adaptive(windows, plan.seed)
    noise = fit_noise([cases_of(held_out), every_change], driver, adaptive)
    write_rivals(plan.out, driver, adaptive, noise, recording.traffic_version(network))
    changes_per_s = changes_to_one_side_per_s(recording.load_all(training))
    return _train_keeping(plan, network, windows, changes_per_s, held_out, say)


def _train_keeping(
    plan: TrainingPlan, net: Network, windows: CarFollowing, changes_per_s: float, held_out: CarFollowing, say: Say
) -> list[Path]:
    led = windows.led
    own, short = plan.out / "lane_keeping.npz", plan.out / "lane_keeping_short.npz"
    say(f"{len(windows)} windows of 10 s, {len(windows) * (STEPS - 1)} samples")
    with _of_enough_traffic(plan):
        driver, follower = driver_fit.fit_driver(windows, changes_per_s, plan.size, plan.seed, say)
        save_driver(own, driver, follower)
        check_that_it_drives(load_learned_driver(own), own)
        say("fitting the paper's short-term model")
        samples = driver_fit.short_samples(led, driver_fit.SHORT_SAMPLES, np.random.default_rng(plan.seed))
        mixture = fit_mixture(*samples, plan.size, plan.seed)
        SHORT.save(short, mixture)
        SHORT.load(short)
    say("scoring on held-out seeds")
    rng = np.random.default_rng(plan.seed)
    held_led = held_out.led
    short_x, short_y = driver_fit.short_samples(held_led, HELD_OUT_SAMPLES, rng)
    asked = driver_fit.recovery_samples(held_led, driver_fit.driver_habit(held_led), HELD_OUT_SAMPLES, rng)
    facts = _facts(plan, net, len(windows) * (STEPS - 1), len(led) * (STEPS - 1))
    own_fit = f"{follower.following.log_density(*asked).mean():.3f} nats (acceleration, recovery samples)"
    write_card(
        own.with_suffix(".md"),
        "Learned driver for lane keeping (`gmm`, ours)",
        {
            **facts,
            "Fit": _fitted_to(driver_fit.FOLLOWING_SAMPLES, plan.seed)
            + "; then again with the states that it reaches itself",
            "Lane changes": f"{changes_per_s:.4f} per second to each side, counted in the training traffic; particles "
            f"of drivers in sight take them up {driver_fit.PROPOSED_CHANGES:g} times as often",
            "One-step log-likelihood on held-out seeds": own_fit,
        },
        errors_by_regime(LearnedDriver(driver, changes_lanes=False), held_out, plan.seed),
        KEEPING_LIMITS,
    )
    short_fit = f"{mixture.log_density(short_x, short_y).mean():.3f} nats (four outputs)"
    write_card(
        short.with_suffix(".md"),
        "Short-term model for lane keeping (`gmm-short`, as in the paper)",
        {
            **facts,
            "Fit": _fitted_to(min(len(led) * (STEPS - 1), driver_fit.SHORT_SAMPLES), plan.seed),
            "One-step log-likelihood on held-out seeds": short_fit,
        },
        errors_by_regime(short_term_driver(mixture), held_out, plan.seed),
        SHORT_LIMITS,
    )
    return [own, short]


def _train_follower(
    plan: TrainingPlan, net: Network, windows: CarFollowing, held_out: CarFollowing, say: Say
) -> list[Path]:
    """Fit a follower that is no mixture; everything else is taken from the committed learned driver."""
    led = windows.led
    say(f"{len(windows)} windows of 10 s, {len(led)} of them behind a leader")
    path = plan.out / f"{plan.case}.npz"
    follower: Follower
    limits: Sequence[str]
    if plan.case == RESIDUAL:
        follower = residual.ResidualFollower(unrolled.fit_residual(windows, plan.seed, say))
        save_network(path, residual.CASE, follower.network._asdict())
        title, limits = "IDM and a network (`residual`, ours)", RESIDUAL_LIMITS
        fit = f"{unrolled.ITERATIONS} steps of Adam on the score of {unrolled.WINDOWS} rollouts of 10 s, "
        fit += f"{unrolled.PARTICLES} particles each; seed {plan.seed}"
        size = f"{residual.INPUTS} inputs, two layers of {unrolled.HIDDEN_UNITS} units, one output"
    elif plan.case == RECURRENT:
        follower = recurrent.RecurrentFollower(recurrent_fit.fit_recurrent(windows, plan.seed, say))
        save_network(path, recurrent.CASE, follower.network._asdict())
        title, limits = "IDM and a network with a memory (`recurrent`, ours)", RECURRENT_LIMITS
        fit = f"{recurrent_fit.ITERATIONS} steps of Adam on the score of {unrolled.WINDOWS} rollouts of up to 10 s, "
        fit += f"{unrolled.PARTICLES} particles each, by JAX; seed {plan.seed}"
        size = f"a gated recurrent unit of {recurrent_fit.UNITS} numbers, {recurrent.OUTPUTS} outputs"
    else:
        follower = driver_fit.fit_empirical(led)
        empirical.save_empirical(path, follower)
        title, limits = "Recorded accelerations (`empirical`, a baseline)", EMPIRICAL_LIMITS
        cells = " x ".join(map(str, follower.changes_mps2.shape[:-1]))
        fit, size = "counted", f"{cells} cells, {driver_fit.QUANTILES} quantiles"
    facts = {**_facts(plan, net, len(windows) * (STEPS - 1), len(led) * (STEPS - 1)), "Fit": fit, "Size": size}
    model = replace(with_follower(follower, plan.case), changes_lanes=False)
    write_card(path.with_suffix(".md"), title, facts, errors_by_regime(model, held_out, plan.seed), limits)
    return [path]


def _train_change(
    plan: TrainingPlan, net: Network, changes: LaneChanges, held_out: LaneChanges, say: Say
) -> list[Path]:
    if (samples := len(changes) * (STEPS - 1)) < plan.size:
        raise InputError(f"`seeds`: {len(changes)} lane changes are too few to train on; give more seeds")
    say(f"{len(changes)} lane changes, {samples} samples")
    path = plan.out / "lane_change.npz"
    with _of_enough_traffic(plan):
        x, y = change_samples(changes, np.random.default_rng(plan.seed), SCATTERED_SHARE)
        mixture = fit_mixture(x, y, plan.size, plan.seed)
        CHANGE.save(path, mixture)
        CHANGE.load(path)
    rng = np.random.default_rng(plan.seed)
    facts = {
        **_facts(plan, net, samples, samples),
        "Fit": _fitted_to(samples, plan.seed),
        "Beside the recorded paths": f"{100 * SCATTERED_SHARE:.0f} % of the samples moved sideways off the recorded "
        f"path, by {change_fit.LAT_M} m, {change_fit.LAT_SPEED_MPS} m/s and {change_fit.LAT_ACCEL_MPS2} m/s², and "
        "going on with the recorded acceleration",
        "One-step log-likelihood on held-out seeds": f"{_held_out_fit(mixture, held_out, SCATTERED_SHARE, rng)}, as "
        f"it was trained (six outputs); {_held_out_fit(mixture, held_out, 0.0, rng)}, on the recorded paths",
    }
    write_card(path.with_suffix(".md"), CHANGE_TITLE, facts, [], CHANGE_LIMITS)
    return [path]


@contextmanager
def _of_enough_traffic(plan: TrainingPlan) -> Iterator[None]:
    """Refuse a fit that fails, or whose file its own reader refuses: few samples leave covariances near zero."""
    try:
        yield
    except (ValueError, np.linalg.LinAlgError) as error:
        why = " ".join(str(error).replace(f"{plan.out}/", "").split())
        told = f"`duration` {plan.duration_s:g}: too little traffic to fit {plan.case} to ({why})"
        raise InputError(f"{told}; give more of `duration` or `seeds`") from error


def _held_out_fit(mixture: ScaledGmm, held_out: LaneChanges, scattered: float, rng: np.random.Generator) -> str:
    held = mixture.log_density(*change_samples(held_out, rng, scattered))
    return f"median {np.median(held):.2f}, mean {held.mean():.2f} nats"


def _facts(plan: TrainingPlan, net: Network, samples: int, used: int) -> dict[str, str]:
    densities = ", ".join(f"{density:g}" for density in plan.densities)
    mixture, options = {}, ""
    if plan.case in PAPER_COMPONENTS:
        paper = f"the paper's setting is {PAPER_COMPONENTS[plan.case]}, kept for comparison and speed"
        mixture = {"Components": f"{plan.size} ({paper}), full covariances"}
        options = f" --components {plan.size}"
    if plan.densities != recording.DENSITIES_VEH_PER_KM_LANE:
        options += f" --densities {densities.replace(', ', ',')}"
    if plan.duration_s != recording.TRAINING_DURATION_S:
        options += f" --duration {plan.duration_s:g}"
    return {
        "Command": f"`python -m harness train --net {net.name} --case {plan.case} "
        f"--seeds {plan.traffic.start}:{plan.traffic.stop} --seed {plan.seed}{options}`",
        TRAFFIC: recording.traffic_version(net),
        "Data": f"SUMO, of each seed {plan.duration_s:g} s at each of {densities} vehicles per km and lane",
        "Seeds": "trained on {}; held out {}".format(*map(recording.first_to_last, (plan.traffic, HELD_OUT_SEEDS))),
        "Samples": f"{samples} extracted, {used} of them with a leader or around a lane change",
        **mixture,
    }


def _fitted_to(samples: int, seed: int) -> str:
    refined = f", refined by EM on {samples}" if samples > START_SAMPLES else ""
    return (
        f"k-means start and EM on {min(samples, START_SAMPLES)} samples{refined}; seed {seed}, regularisation 1e-6 of "
        "standardised variables"
    )


KEEPING_LIMITS = (
    "Trained on SUMO's drivers; a leader further than 100 m ahead counts as none.",
    "The way back to the recorded trajectory is taught with gains chosen by hand (0.05 per s², 0.4 per s, 1.5 per s).",
    "The spread of a driver's constant deviation in acceleration was chosen on the tuning seeds.",
    "Knows no traffic lights, no standing obstacles that are not vehicles, and no look-ahead beyond the leader.",
)
EMPIRICAL_LIMITS = (
    "Steps are drawn one by one: what outlasts the acceleration, such as a driver's habit, is not in it.",
    "Without a leader, and across the lane, it is `gmm`.",
)
RESIDUAL_LIMITS = (
    "Trained on SUMO's drivers; a leader further than 100 m ahead counts as none. Across the lane, and without a "
    "leader on a network of roads, it is `gmm`.",
    "Half of the leaders were taken for somewhat different ones in training, and a fifth was left out; how far "
    "off, and how many, was set by hand.",
    "Beyond the range of its inputs in training it takes them for the range's end; IDM's part goes on.",
)
RECURRENT_LIMITS = (*RESIDUAL_LIMITS, "Training needs the extra `deep` (JAX); running it does not.")
SHORT_LIMITS = (
    "One step ahead is all that it was fitted to: errors feed back, and its particles are too alike after seconds.",
    "Lateral position counts from the middle of the own lane, so that the model carries over to other roads.",
    "Without a leader it is given the furthest leader of the training data at its own speed.",
)
CHANGE_TITLE = "Short-term model for lane changes (`gmm-lane-change`, as in the paper)"
CHANGE_LIMITS = (
    "SUMO's lateral accelerations take few distinct values, so densities are peaked: rare samples off the peaks pull "
    "the mean log-likelihood far below the median.",
    "Meant for vehicles that are known to be within five seconds of a lane change; it does not say when one begins.",
    "Once over the line the follower in the target lane is not among the inputs.",
    "Longitudinal position, an input of the paper's table, is held to the training road's range elsewhere.",
    "How far samples are moved off the recorded path was chosen by hand and checked on the tuning seeds.",
)
