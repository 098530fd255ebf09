"""Truth from SUMO, in this process through libsumo, or in a window beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from harness.errors import InputError, RunError
from harness.truth.frame import Frame
from harness.truth.network.demand import DEFAULT_DENSITY, Demand
from harness.truth.network.network import Network
from harness.truth.sumo.control import TrafficControl
from harness.truth.sumo.ego import NO_EGO, EgoChoice, choose_ego
from harness.truth.sumo.reading import Load, read_frame, read_load
from harness.truth.sumo.session import Sumo, show_ego, start_sumo, stop_sumo, sumo_errors_in_words
from harness.truth.sumo.smoothing import lead_frames, smoothed
from mmpf.road import Road

STEP_S = 0.1
WARM_UP_S = 20.0
FIRST_VEHICLE_WITHIN_S = 900.0
LATERAL_RESOLUTION_M = "0.92"


def open_traffic(
    network: Network,
    *,
    density: float | None = None,
    demand: str | None = None,
    duration_s: float,
    seed: np.random.SeedSequence | int,
    step_s: float = STEP_S,
    warm_up_s: float = WARM_UP_S,
    ego: bool = True,
    gui: bool = False,
) -> SumoTruth:
    """Start SUMO on a network, run the warm-up and return the truth that follows.

    Args:
        network: The network.
        density: Vehicles per km and main lane to be held. If neither this nor ``demand`` is given, the network's
            default demand is taken, and a density of 30 where it names none.
        demand: Name of one of the network's demands, in place of a density.
        duration_s: How long frames are yielded for.
        seed: Seed of drivers, arrivals and SUMO's own randomness.
        step_s: Time between frames.
        warm_up_s: How long the traffic runs before the first frame.
        ego: Whether an ego vehicle is chosen; without one a frame's ``ego`` is -1.
        gui: Whether the traffic is shown in a window of sumo-gui; it is the same traffic.

    Raises:
        InputError: The density, the demand or the network's files are wrong, or no window can be opened.
        RunError: A simulation is open already, or no vehicle ever appears.
    """
    if density is not None and demand is not None:
        raise InputError("give either `density` or `demand`, not both")
    if network.configuration is not None:
        if demand is not None:
            raise InputError(f"`demand` {demand}: {network.name} brings its own demand; leave `demand` out")
        return _open_own_demand(network, duration_s, seed, step_s, warm_up_s, ego, gui)
    if demand is None and density is None:
        demand = network.default_demand
    if demand is not None:
        held = network.demand(demand)
    else:
        held = network.demand_for_density(DEFAULT_DENSITY if density is None else density)
    return _open_held_demand(network, held, duration_s, seed, step_s, warm_up_s, ego, gui)


class SumoTruth:
    """Frames of a running SUMO simulation.

    Attributes:
        road: The road frame.
        step_s: Time between frames.
        expected_steps: How many frames there will be.
    """

    def __init__(
        self, sumo: Sumo, network: Network, steps: int, step_s: float, control: TrafficControl | None, ego: bool
    ) -> None:
        """Take over a simulation that has started."""
        self.road: Road = network.road
        self.step_s = step_s
        self.expected_steps = steps
        self._sumo = sumo
        self._network = network
        self._control = control
        self._wants_ego = ego
        self._open = True

    def warm_up(self, duration_s: float) -> None:
        """Let the traffic run without yielding frames, and on until there is a vehicle in the section."""
        for _ in range(round(duration_s / self.step_s)):
            self._advance()
        for _ in range(round(FIRST_VEHICLE_WITHIN_S / self.step_s)):
            if read_load(self._sumo, self.road).inside:
                return
            self._advance()
        raise RunError(f"no vehicle entered the section of {self._network.name} within {FIRST_VEHICLE_WITHIN_S:g} s")

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order; they end early if the user's own demand runs dry."""
        ego = EgoChoice(vehicle_id=NO_EGO, episode=-1)
        for frame in smoothed(self._raw_frames(), self.road, self.step_s):
            if self._wants_ego:
                previous, ego = ego, choose_ego(frame, ego, self._network.ego_lanes, self.road.section_m)
                if ego.vehicle_id == NO_EGO:
                    return
                if ego != previous:
                    show_ego(self._sumo, ego.vehicle_id)
                yield ego.apply(frame)
            else:
                yield frame

    def _raw_frames(self) -> Iterator[Frame]:
        for step in range(self.expected_steps + 2 * lead_frames(self.step_s)):
            if step:
                self._advance()
            with sumo_errors_in_words(self._sumo):
                frame = read_frame(self._sumo, self.road, step, step * self.step_s)
            yield frame

    def close(self) -> None:
        """End the simulation; harmless to call twice."""
        if self._open:
            self._open = False
            stop_sumo(self._sumo)

    def _advance(self) -> None:
        with sumo_errors_in_words(self._sumo):
            if self._control is not None:
                self._control.before_step(self._sumo.simulation.getTime(), self._measure)
            self._sumo.simulationStep()

    def _measure(self) -> Load:
        return read_load(self._sumo, self.road)


def _open_held_demand(
    network: Network,
    demand: Demand,
    duration_s: float,
    seed: np.random.SeedSequence | int,
    step_s: float,
    warm_up_s: float,
    ego: bool,
    gui: bool,
) -> SumoTruth:
    rng = np.random.default_rng(seed)
    arguments = (
        *("--net-file", str(network.net_file), "--additional-files", str(network.vehicle_types_file)),
        *("--lateral-resolution", LATERAL_RESOLUTION_M, "--insertion-checks", "none"),
        *("--time-to-teleport", "-1", "--collision.action", "warn"),
    )
    sumo = start_sumo(arguments, step_s, int(rng.integers(2**31)), gui)
    control = TrafficControl(sumo, network, demand, rng, step_s, warm_up_s)
    truth = SumoTruth(sumo, network, round(duration_s / step_s), step_s, control, ego)
    return _warmed_up(sumo, truth, warm_up_s, control.fill)


def _open_own_demand(
    network: Network,
    duration_s: float,
    seed: np.random.SeedSequence | int,
    step_s: float,
    warm_up_s: float,
    ego: bool,
    gui: bool,
) -> SumoTruth:
    assert network.configuration is not None
    sumo_seed = int(np.random.default_rng(seed).integers(2**31))
    sumo = start_sumo(("--configuration-file", str(network.configuration.path)), step_s, sumo_seed, gui)
    truth = SumoTruth(sumo, network, round(duration_s / step_s), step_s, None, ego)
    return _warmed_up(sumo, truth, warm_up_s, lambda: None)


def _warmed_up(sumo: Sumo, truth: SumoTruth, warm_up_s: float, fill: Callable[[], None]) -> SumoTruth:
    try:
        with sumo_errors_in_words(sumo):
            fill()
            truth.warm_up(warm_up_s)
    except BaseException:
        truth.close()
        raise
    return truth
