"""What the transfer study trains on and tests on: simulated windows, real pairs and real snippets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.lab.windows.car_following import Following, following_windows, join
from harness.lab.windows.cases import Cases, cases_of
from harness.lab.windows.pairs import recording_of
from harness.truth.frame import STEP_S
from harness.truth.recorded.formats import network_of, read_traffic, recognise
from harness.truth.recorded.traffic import assemble, check_one_road
from mmpf.numerics.arrays import IntArray

SHORT_STEPS = 51
PAIRS, SNIPPETS, SUMO = "real pairs", "real snippets", "sumo"
WHOLE_RECORDING_S = 86_400.0

Say = Callable[[str], None]


@dataclass(frozen=True)
class HeldOutPart:
    """Cases of one length.

    Attributes:
        cases: The cases.
        vehicle: Vehicle of each case, shape (m,); cases of one vehicle are no independent samples.
        horizons_s: What is reported from these cases.
    """

    cases: Cases
    vehicle: IntArray
    horizons_s: tuple[float, ...]


@dataclass(frozen=True)
class HeldOutSet:
    """Traffic that no model was trained on.

    Attributes:
        name: What it is.
        parts: Cases by length.
        led: The windows behind the cases of the first part.
    """

    name: str
    parts: tuple[HeldOutPart, ...]
    led: Following


def split_pairs(windows: Following, seed: int) -> tuple[Following, Following]:
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


def mixed(simulated: Following, real: Following, most: int, seed: int) -> Following:
    """Return as many simulated as real windows; real ones, of which there are few, come several times.

    Args:
        simulated: Windows with leaders.
        real: Likewise.
        most: Most windows of either kind.
        seed: Seed of the choice of simulated windows.
    """
    count = min(most, len(simulated))
    chosen = np.random.default_rng([seed, 4]).choice(len(simulated), size=count, replace=False)
    return join([simulated.take(np.sort(chosen)), real.take(np.resize(np.arange(len(real)), count))])


def snippet_windows(files: Sequence[Path], steps: int, say: Say) -> Following:
    """Cut windows from files of recorded traffic; a line for each file says how many vehicles gave any.

    Raises:
        InputError: A file can't be read, or there is no window in any.
    """
    parts = []
    for path in files:
        entry = recognise(path)
        traffic = assemble(read_traffic(path, entry.name, network_of(entry, None)), path, WHOLE_RECORDING_S)
        check_one_road(traffic, path)
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


def held_out_set(name: str, by_length: Sequence[tuple[Following, tuple[float, ...]]]) -> HeldOutSet:
    """Return windows of one or several lengths as a test set; every window is a case."""
    parts = tuple(HeldOutPart(cases_of(led, STEP_S), led.vehicle, horizons) for led, horizons in by_length)
    return HeldOutSet(name, parts, by_length[0][0])
