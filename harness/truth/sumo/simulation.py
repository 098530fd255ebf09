"""Truth from SUMO, in this process through libsumo, or with its own window."""

import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import numpy as np

from harness.common.errors import InputError, SumoError
from harness.truth.frame import STEP_S, Frame, TruthSource
from harness.truth.network.demand import DEFAULT_DENSITY, Demand
from harness.truth.network.network import Network
from harness.truth.network.sumocfg import SumoInputs
from harness.truth.sumo.apart import TrafficApart
from harness.truth.sumo.brokendown import place_broken_down
from harness.truth.sumo.control import TrafficControl
from harness.truth.sumo.corridor_traffic import CorridorTraffic
from harness.truth.sumo.inflow import Inflow
from harness.truth.sumo.plane_traffic import REACH_M, PlaneTraffic
from harness.truth.sumo.session import RunningSumo, show_ego, start_sumo, sumo_errors_in_words
from harness.truth.sumo.smoothing import CausalFilter
from mmpf.map.road import Road

WARM_UP_S = 20.0
LANE_CHANGE_S = "3"
NO_EGO = ""


def open_traffic(
    network: Network,
    *,
    demand: str | float | None = None,
    duration_s: float,
    seed: np.random.SeedSequence | int,
    warm_up_s: float = WARM_UP_S,
    ego: bool = True,
    gui: bool = False,
    reach_m: float = REACH_M,
    broken_down: int = 0,
    flow_mps: float | None = None,
    on_step: Callable[[], None] | None = None,
) -> TruthSource:
    """Start SUMO on a network, run the warm-up and return the truth that follows.

    Args:
        demand: Name of one of the network's demands, or a density to be held, vehicles per km and main lane, in the
            plane per km and lane of the whole network. If not given, the network's default demand is taken, and a
            density of 30 where it names none.
        reach_m: How far from the ego vehicles count and hide, on a network without a main road.
        broken_down: How many vehicles stand broken down in main lanes of the section, from before the first frame on.
        flow_mps: Speed limit of the main road and at most of its ramps, in place of the network's; None for that.

    Raises:
        InputError: The density, the demand or the network's files are wrong, no window can be opened, or the network
            has no room for vehicles that break down, or no main road to limit speeds on.
        RunError: A simulation is open already, or no vehicle ever appears.
    """
    if on_step is None and not gui and not network.is_shipped:
        return TrafficApart(
            network,
            lambda goes_on: open_traffic(
                network,
                demand=demand,
                duration_s=duration_s,
                seed=seed,
                warm_up_s=warm_up_s,
                ego=ego,
                reach_m=reach_m,
                broken_down=broken_down,
                flow_mps=flow_mps,
                on_step=goes_on,
            ),
        )
    rng = np.random.default_rng(seed)
    held = _held_demand(network, demand)
    stands = place_broken_down(network, broken_down, seed)
    limits = {} if flow_mps is None else _speed_limits(network, flow_mps)
    # Now, since a broken file of buildings would leave a simulation open.
    _ = network.road
    scratch = TemporaryDirectory(prefix="harness-net-")
    try:
        sumo = start_sumo(_arguments(network, Path(scratch.name)), int(rng.integers(2**31)), gui)
    except BaseException as error:
        scratch.cleanup()
        if isinstance(error, InputError):
            raise InputError(re.sub(rf"{scratch.name}/\d+-\d+-", "", str(error))) from error
        raise
    # SUMO reads vehicles while it runs, so links to its files stay for as long.
    running, steps = RunningSumo(sumo, scratch.cleanup, on_step), round(duration_s / STEP_S)
    traffic: RoadTraffic
    if network.plane is not None:
        inflow = None if held is None else Inflow(sumo, held.density_veh_per_km_lane, network.plane.lanes_m)
        traffic = PlaneTraffic(running, network, network.plane, reach_m, inflow)
    else:
        control = None if held is None else TrafficControl(sumo, network, held, rng, STEP_S, warm_up_s, stands)
        traffic = CorridorTraffic(running, network, control)
    truth = SumoTruth(running, network.road, traffic, steps, ego)
    try:
        with sumo_errors_in_words(sumo):
            for edge, limit_mps in limits.items():
                sumo.edge.setMaxSpeed(edge, limit_mps)
            truth.warm_up(warm_up_s)
    except SumoError as error:
        truth.close()
        if held is None or not network.is_shipped:
            # SUMO reads vehicles only when they depart, and of what types they are.
            raise InputError(f"`net`: SUMO refuses the input: {error.reason}") from error
        raise
    except BaseException:
        truth.close()
        raise
    return truth


def _held_demand(network: Network, demand: str | float | None) -> Demand | None:
    """Return what the traffic is held at; None on a network that brings its own demand."""
    if network.configuration is not None:
        if isinstance(demand, str):
            raise InputError(f"`demand` {demand}: {network.name} brings its own demand; leave `demand` out")
        return None
    if demand is None:
        demand = DEFAULT_DENSITY if network.default_demand is None else network.default_demand
    return network.demand(demand) if isinstance(demand, str) else network.demand_for_density(demand)


def _speed_limits(network: Network, flow_mps: float) -> dict[str, float]:
    """Return the speed limits of edges where the main road's is to be another."""
    main = dict.fromkeys((edge.name for edge in network.main_road.edges), flow_mps)
    ramps = {ramp.name: min(flow_mps, ramp.speed_limit_mps) for ramp in (*network.on_ramps, *network.off_ramps)}
    return main | ramps


def _arguments(network: Network, scratch: Path) -> tuple[str, ...]:
    """Return SUMO's arguments; what its files would write beside themselves lands beside links to them."""
    inputs = network.sumo_inputs
    return (
        *_file_list("--net-file", [inputs.net_file], scratch),
        *_file_list("--route-files", inputs.route_files, scratch),
        *_file_list("--additional-files", inputs.additional_files, scratch),
        *(word for name, value in inputs.options for word in (f"--{name}", value)),
        *_gradual_lane_changes(inputs),
    )


def _gradual_lane_changes(inputs: SumoInputs) -> tuple[str, ...]:
    """Let lane changes take time where the configuration would have vehicles jump from lane to lane."""
    given = dict(inputs.options)
    if "lateral-resolution" in given or "lanechange.duration" in given:
        return ()
    return ("--lanechange.duration", LANE_CHANGE_S)


def _file_list(option: str, files: Sequence[Path], scratch: Path) -> tuple[str, ...]:
    links = [scratch / f"{len(option)}-{place}-{file.name}" for place, file in enumerate(files)]
    for link, file in zip(links, files, strict=True):
        link.symlink_to(file.absolute())
    return (option, ",".join(map(str, links))) if links else ()


class RoadTraffic(Protocol):
    """What depends on the kind of road.

    Attributes:
        lead: How many readings before and after a smoothed frame it is made of.
        waits_s: For how long time stands still where there is no ego.
        jumpy: Columns of ``Frame`` that SUMO changes from one step to the next.
    """

    lead: int
    waits_s: float
    jumpy: tuple[str, ...]

    def fill(self) -> None:
        """Put traffic on the road before the warm-up."""

    def wait(self) -> None:
        """Go on until there can be an ego.

        Raises:
            InputError: No vehicle ever appears, and the user's files are to blame.
            RunError: None appears.
        """

    def read(self) -> object:
        """Return the vehicles as they are now."""

    def present(self, step: int) -> Frame:
        """Return the vehicles as they are now, as a frame with neither an ego nor a past."""

    def frame(self, window: Sequence[Any], step: int, ego: str | None) -> Frame | None:
        """Return the frame in the middle of readings, smoothed.

        Args:
            window: The readings, ``2 lead + 1``.
            step: Number of the frame.
            ego: The ego so far, empty for none: the frame's is it, or if it has left another one. None asks for none.

        Returns:
            The frame; None where no vehicle can be the ego.
        """


class SumoTruth:
    """Frames of a running SUMO simulation, which is open to those who drive in it themselves."""

    def __init__(self, running: RunningSumo, road: Road, traffic: RoadTraffic, steps: int, ego: bool) -> None:
        """Take over a simulation that has started."""
        self.road, self.step_s, self.expected_steps, self.running = road, STEP_S, steps, running
        self._traffic, self._wants_ego = traffic, ego
        self._filter = CausalFilter(traffic.jumpy)

    def warm_up(self, duration_s: float) -> None:
        """Let the traffic run without yielding frames, and on until there can be an ego."""
        self._traffic.fill()
        for _ in range(round(duration_s / self.step_s)):
            self.running.advance()
        self._traffic.wait()

    def present(self, step: int) -> Frame:
        """Return everybody at this moment, for a loop that acts on it and calls this once a step; there is no ego."""
        with sumo_errors_in_words(self.running.sumo):
            return self._filter.filtered(self._traffic.present(step))

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, half a second late and smoothed.

        Where nobody can be the ego, they end, or on a network in the plane time stands still for as long as it waits.
        """
        sumo, lead = self.running.sumo, self._traffic.lead
        window: deque[object] = deque(maxlen=2 * lead + 1)
        ego, episode, step, idle_s = NO_EGO, -1, 0, 0.0
        while step < self.expected_steps and idle_s <= self._traffic.waits_s:
            if window:
                self.running.advance()
            with sumo_errors_in_words(sumo):
                window.append(self._traffic.read())
            if len(window) < 2 * lead + 1:
                continue
            frame = self._traffic.frame(window, step, ego if self._wants_ego else None)
            if frame is None:
                ego, idle_s = NO_EGO, idle_s + self.step_s
                continue
            if self._wants_ego and (name := str(frame.vehicle_id[frame.ego])) != ego:
                ego, episode = name, episode + 1
                show_ego(sumo, ego)
            yield replace(frame, episode=max(episode, 0))
            step, idle_s = step + 1, 0.0

    def close(self) -> None:
        """End the simulation; harmless to call twice."""
        self.running.close()
