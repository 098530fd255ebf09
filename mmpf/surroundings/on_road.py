"""For each type of road: how vehicles move, each particle's surroundings, and how beliefs are reported."""

from dataclasses import dataclass
from functools import partial, singledispatch
from typing import Protocol

from mmpf.belief.birth import Traffic
from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments, component_moments
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.motion.doubting import Doubting
from mmpf.motion.off_map import in_plane
from mmpf.motion.protocol import MotionModel, Surroundings
from mmpf.motion.standing import Standing
from mmpf.numerics.arrays import BoolArray, FloatArray
from mmpf.options.filter import FilterOptions
from mmpf.scan import Scan
from mmpf.surroundings.on_corridor import surroundings_of
from mmpf.surroundings.on_graph import surroundings_on_graph
from mmpf.surroundings.reported_route import on_heaviest_way
from mmpf.surroundings.right_of_way import SignalEstimator

Belief = tuple[Mixture, Moments, BoolArray]


class OnRoad(Protocol):
    """What a filter asks of its road."""

    def options(self, options: FilterOptions) -> FilterOptions:
        """Return the filter's settings on this road."""

    def motion(self, model: MotionModel) -> MotionModel:
        """Return how a model's vehicles move on this road."""

    def traffic(self, place: FloatArray, speed_mps: FloatArray) -> Traffic:
        """Return speeds of vehicles at places, shape (2, k)."""

    def surroundings(self, belief: Belief, before: Scan, now: Scan) -> Surroundings:
        """Return what each particle knows of road and traffic; asked once a scan, in order.

        Args:
            belief: The belief, its components' moments and which components were seen lately, shape (m,).
            before: The scan that the belief is of.
            now: The present scan.
        """

    def reported(self, mixture: Mixture, moments: Moments) -> tuple[Mixture, Moments]:
        """Return what of the belief is reported, with its components' moments."""


@dataclass(frozen=True)
class _OnCorridor:
    road: CorridorRoad

    def options(self, options: FilterOptions) -> FilterOptions:
        return options

    def motion(self, model: MotionModel) -> MotionModel:
        return Doubting(Standing(model))

    def traffic(self, place: FloatArray, speed_mps: FloatArray) -> Traffic:
        return Traffic(place[0], speed_mps)

    def surroundings(self, belief: Belief, before: Scan, now: Scan) -> Surroundings:
        return surroundings_of(*belief, before.ego, _ego_accel(before, now), self.road)

    def reported(self, mixture: Mixture, moments: Moments) -> tuple[Mixture, Moments]:
        return mixture, moments


class _OnGraph:
    def __init__(self, road: LaneGraphRoad) -> None:
        self._graph, self._links = road.graph, SignalEstimator(road.graph)

    def options(self, options: FilterOptions) -> FilterOptions:
        return options.model_copy(update={"joint": options.joint.in_plane()})

    def motion(self, model: MotionModel) -> MotionModel:
        return in_plane(model, self._graph)

    def traffic(self, place: FloatArray, speed_mps: FloatArray) -> Traffic:
        return Traffic(place[0], speed_mps, place[1])

    def surroundings(self, belief: Belief, before: Scan, now: Scan) -> Surroundings:
        open_links = partial(self._links.look, open_signals=before.open_signals, dt_s=now.time_s - before.time_s)
        around = *belief, before.ego, _ego_accel(before, now)
        return surroundings_on_graph(*around, self._graph, open_links)

    def reported(self, mixture: Mixture, moments: Moments) -> tuple[Mixture, Moments]:
        chosen = on_heaviest_way(mixture, self._graph)
        return (mixture, moments) if chosen is mixture else (chosen, component_moments(chosen))


@singledispatch
def on_road(road: Road) -> OnRoad:
    """Return what a filter asks of a road.

    Args:
        road: The road, of one of the kinds that there are.
    """
    raise TypeError(f"{type(road).__name__} is no kind of road that vehicles move on")


@on_road.register
def _(road: CorridorRoad) -> OnRoad:
    return _OnCorridor(road)


@on_road.register
def _(road: LaneGraphRoad) -> OnRoad:
    return _OnGraph(road)


def _ego_accel(before: Scan, now: Scan) -> float:
    return (now.ego.speed_mps - before.ego.speed_mps) / (now.time_s - before.time_s)
