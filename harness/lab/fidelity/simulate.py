"""Simulated traffic on the cells of the recorded traffic, and samples of its vehicles."""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context

from harness.common.isolation import end_with_parent
from harness.lab.fidelity.fields import Fields, fields_from_frames
from harness.lab.fidelity.samples import BehaviourSamples, samples_of
from harness.truth.network.network import Network
from harness.truth.sumo.simulation import open_traffic

SimulatedRun = tuple[Fields, BehaviourSamples]
"""The fields of a simulated run, and samples of what its vehicles did."""


def within(network: Network, demand: str, measured_s: float, duration_s: float) -> Network:
    """Return a network whose demand goes through the schedule of a measured period in another time."""
    known, share = network.demand_files[demand], duration_s / measured_s
    schedule = tuple((from_s * share, density, waves) for from_s, density, waves in known.schedule)
    return network.with_demand(demand, known.model_copy(update={"schedule": schedule}))


@dataclass(frozen=True)
class RunJob:
    """A run to be made, without an ego."""

    network: Network
    demand: str
    duration_s: float
    seed: int

    def run(self) -> SimulatedRun:
        """Make the run in this process."""
        truth = open_traffic(self.network, demand=self.demand, duration_s=self.duration_s, seed=self.seed, ego=False)
        try:
            frames = list(truth.frames())
        finally:
            truth.close()
        return fields_from_frames(frames, truth.step_s), samples_of(frames, self.network.section_m, truth.step_s)


def simulate_all(jobs: Sequence[RunJob], workers: int, on_done: Callable[[], None]) -> list[SimulatedRun]:
    """Make runs in processes of their own, since a process holds one simulation; return them in order."""
    count, context = min(workers, len(jobs)), get_context("spawn")
    # When this process is killed the pool itself would wait for ever.
    with ProcessPoolExecutor(count, mp_context=context, initializer=end_with_parent) as pool:
        futures = [pool.submit(job.run) for job in jobs]
        try:
            for future in as_completed(futures):
                future.result()
                on_done()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]
