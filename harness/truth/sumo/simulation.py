"""Truth from SUMO, in this process through libsumo, or in a window beside it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import numpy.typing as npt

from harness.common.errors import InputError, RunError, SumoError
from harness.truth.frame import STEP_S, Frame, TruthSource
from harness.truth.network.demand import DEFAULT_DENSITY, Demand
from harness.truth.network.network import LATERAL_RESOLUTION_M, Network
from harness.truth.network.sumocfg import SumoInputs
from harness.truth.sumo.apart import TrafficApart
from harness.truth.sumo.brokendown import BROKEN_DOWN, place_broken_down
from harness.truth.sumo.control import TrafficControl
from harness.truth.sumo.inflow import Inflow
from harness.truth.sumo.planetruth import REACH_M, PlaneTruth
from harness.truth.sumo.reading import read_frame, read_load
from harness.truth.sumo.running import FIRST_VEHICLE_WITHIN_S, RunningSumo
from harness.truth.sumo.session import show_ego, start_sumo, sumo_errors_in_words
from harness.truth.sumo.smoothing import lead_frames, smoothed
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import FloatArray, IntArray

WARM_UP_S = 20.0
LANE_CHANGE_S = "3"
NO_EGO = ""
START_WINDOW_M = 60.0
CAR_LENGTH_M = (3.0, 6.5)


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
        network: The network.
        demand: Name of one of the network's demands, or a density to be held, vehicles per km and main lane, in the
            plane per km and lane of the whole network. If not given, the network's default demand is taken, and a
            density of 30 where it names none.
        duration_s: How long frames are yielded for.
        seed: Seed of drivers, arrivals and SUMO's own randomness.
        warm_up_s: How long the traffic runs before the first frame.
        ego: Whether an ego vehicle is chosen; without one a frame's ``ego`` is -1.
        gui: Whether the traffic is shown in a window of sumo-gui; it is the same traffic.
        reach_m: How far from the ego vehicles count and hide, on a network without a main road.
        broken_down: How many vehicles stand broken down in main lanes of the section, from before the first frame on.
        flow_mps: Speed limit of the main road and at most of its ramps, in place of the network's; None for that.
        on_step: Called after each step by a process that is made for a network from elsewhere; None makes one.

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
        sumo = start_sumo(_arguments(network, Path(scratch.name)), STEP_S, int(rng.integers(2**31)), gui)
    except BaseException as error:
        scratch.cleanup()
        if isinstance(error, InputError):
            raise InputError(re.sub(rf"{scratch.name}/\d+-\d+-", "", str(error))) from error
        raise
    # SUMO reads vehicles while it runs, so links to its files stay for as long.
    running, steps = RunningSumo(sumo, scratch.cleanup, on_step), round(duration_s / STEP_S)
    truth: SumoTruth | PlaneTruth
    if network.plane is not None:
        inflow = None if held is None else Inflow(sumo, held.density_veh_per_km_lane, network.plane.lanes_m)
        truth = PlaneTruth(running, network, network.plane, steps, ego=ego, reach_m=reach_m, inflow=inflow)
    else:
        control = None if held is None else TrafficControl(sumo, network, held, rng, STEP_S, warm_up_s, stands)
        truth = SumoTruth(running, network, steps, control, ego)
    try:
        with sumo_errors_in_words(sumo):
            for edge, limit_mps in limits.items():
                sumo.edge.setMaxSpeed(edge, limit_mps)
            truth.warm_up(warm_up_s)
    except SumoError as error:
        truth.close()
        if held is None:
            # Nothing but the user's own files has been asked of SUMO yet, which reads vehicles only when they depart.
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
    if inputs is not None:
        return (
            *_file_list("--net-file", [inputs.net_file], scratch),
            *_file_list("--route-files", inputs.route_files, scratch),
            *_file_list("--additional-files", inputs.additional_files, scratch),
            *(word for name, value in inputs.options for word in (f"--{name}", value)),
            *_gradual_lane_changes(inputs),
        )
    assert network.vehicle_types_file is not None
    return (
        *_file_list("--net-file", [network.net_file], scratch),
        *_file_list("--additional-files", [network.vehicle_types_file], scratch),
        *("--lateral-resolution", LATERAL_RESOLUTION_M, "--insertion-checks", "none"),
        # Bodies that touch are collisions, and gaps that are merely too small are none.
        *("--time-to-teleport", "-1", "--collision.action", "warn", "--collision.mingap-factor", "0"),
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


class SumoTruth:
    """Frames of a running SUMO simulation along a main road.

    Attributes:
        road: The road frame.
        step_s: Time between frames.
        expected_steps: How many frames there will be.
        running: The simulation, for those who drive in it themselves.
    """

    def __init__(
        self, running: RunningSumo, network: Network, steps: int, control: TrafficControl | None, ego: bool
    ) -> None:
        """Take over a simulation that has started."""
        self.road: Road = network.corridor_road
        self.step_s = STEP_S
        self.expected_steps = steps
        self.running, self._sumo = running, running.sumo
        if control is not None:
            running.before_step = control.before_step
        self._network = network
        self._control = control
        self._wants_ego = ego

    def warm_up(self, duration_s: float) -> None:
        """Fill the road and let the traffic run without yielding frames, and on until a vehicle is in the section."""
        if self._control is not None:
            self._control.fill()
        for _ in range(round(duration_s / self.step_s)):
            self.running.advance()
        for _ in range(round(FIRST_VEHICLE_WITHIN_S / self.step_s)):
            if read_load(self._sumo, self._network.corridor_road).inside:
                return
            self.running.advance()
        raise RunError(f"no vehicle entered the section of {self._network.name} within {FIRST_VEHICLE_WITHIN_S:g} s")

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order; they end early if the user's own demand runs dry."""
        ego = EgoChoice(vehicle_id=NO_EGO, episode=-1)
        for frame in smoothed(self._raw_frames(), self._network.corridor_road, self.step_s):
            if self._wants_ego:
                previous, ego = ego, choose_ego(frame, ego, self._network.ego_lanes, self.road.section_m)
                if ego.vehicle_id == NO_EGO:
                    return
                if ego != previous:
                    show_ego(self._sumo, ego.vehicle_id)
                yield ego.apply(frame)
            else:
                yield frame

    def close(self) -> None:
        """End the simulation; harmless to call twice."""
        self.running.close()

    def _raw_frames(self) -> Iterator[Frame]:
        for step in range(self.expected_steps + 2 * lead_frames(self.step_s)):
            if step:
                self.running.advance()
            with sumo_errors_in_words(self._sumo):
                frame = read_frame(self._sumo, self._network.corridor_road, step, step * self.step_s)
            yield frame


@dataclass(frozen=True)
class EgoChoice:
    """Which vehicle is the ego.

    Attributes:
        vehicle_id: Its name; empty if there is none.
        episode: Number of its stay, from 0.
    """

    vehicle_id: str
    episode: int

    def apply(self, frame: Frame) -> Frame:
        """Return the frame with this ego and episode."""
        index = int(np.flatnonzero(frame.vehicle_id == self.vehicle_id)[0])
        return replace(frame, ego=index, episode=self.episode)


def choose_ego(frame: Frame, present: EgoChoice, ego_lanes: Sequence[int], section_m: tuple[float, float]) -> EgoChoice:
    """Keep the present ego while it is on the section's lanes, else choose another and begin a new episode.

    A car on one of ``ego_lanes`` within 60 m of the section's start comes first; failing that the best there is, but
    none that has broken down. Empty ``vehicle_id`` if no vehicle is on the section.
    """
    inside = (frame.lon_m >= section_m[0]) & (frame.lon_m < section_m[1]) & (frame.lane != NO_LANE)
    if np.any(inside & (frame.vehicle_id == present.vehicle_id)):
        return present
    candidates = np.flatnonzero(inside & ~np.char.startswith(frame.vehicle_id, BROKEN_DOWN))
    if len(candidates) == 0:
        return EgoChoice(vehicle_id=NO_EGO, episode=present.episode + 1)
    best = candidates[np.lexsort(_worse_first_keys(frame, candidates, ego_lanes, section_m[0]))[0]]
    return EgoChoice(vehicle_id=str(frame.vehicle_id[best]), episode=present.episode + 1)


def _worse_first_keys(
    frame: Frame, candidates: IntArray, ego_lanes: Sequence[int], start_m: float
) -> tuple[FloatArray | npt.NDArray[np.bool_], ...]:
    """Return sort keys, the last the most important, as ``numpy.lexsort`` takes them."""
    lon = frame.lon_m[candidates] - start_m
    length = frame.length_m[candidates]
    no_car = (length < CAR_LENGTH_M[0]) | (length > CAR_LENGTH_M[1])
    beyond_window_m = np.maximum(0.0, lon - START_WINDOW_M)
    wrong_lane = ~np.isin(frame.lane[candidates], np.asarray(ego_lanes))
    return lon, beyond_window_m, no_car, wrong_lane
