"""The route reported for a hidden vehicle: the one with the largest particle weight."""

from dataclasses import replace

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.map.lane_graph import LaneColumns, LaneGraph
from mmpf.motion.lane_following import guidance
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel

# Lanes that one vehicle's particles can be on before some go uncounted.
MOST_LANES = 64


def on_heaviest_way(mixture: Mixture, graph: LaneGraph) -> Mixture:
    """Return the belief with all weight of each component on its heaviest lane and those that lead to or from it.

    A mean over particles on several ways would lie between them, where no vehicle can be.

    Args:
        mixture: The belief, of particles on the graph's lanes.
        graph: The lanes.
    """
    cloud = mixture.cloud
    lane, _ = guidance(cloud.latents)
    weight = np.exp(cloud.log_weight)
    keep = np.ones(len(lane), dtype=np.bool_)
    _find_heaviest(lane, weight, mixture.starts, graph.columns, keep)
    if keep.all():
        return mixture
    weight = np.where(keep, weight, 0.0)
    total = np.bincount(cloud.component, weight, minlength=len(mixture))
    with np.errstate(divide="ignore"):
        log_weight = np.log(weight / total[cloud.component])
    return replace(mixture, cloud=replace(cloud, log_weight=log_weight))


@kernel()
def _find_heaviest(lane: IntArray, weight: FloatArray, starts: IntArray, lanes: LaneColumns, keep: BoolArray) -> None:
    """Write which particles are on their component's heaviest lane, beside it, before it or behind it."""
    names, sums = np.empty(MOST_LANES, dtype=np.int64), np.empty(MOST_LANES)
    for m in range(len(starts) - 1):
        found = 0
        for n in range(starts[m], starts[m + 1]):
            k = 0
            while k < found and names[k] != lane[n]:
                k += 1
            if k == found:
                if found == MOST_LANES:
                    continue
                names[k], sums[k] = lane[n], 0.0
                found += 1
            sums[k] += weight[n]
        if found < 2:
            continue
        best = names[np.argmax(sums[:found])]
        for n in range(starts[m], starts[m + 1]):
            keep[n] = _go_together(best, lane[n], lanes)


@kernel()
def _go_together(one: int, other: int, lanes: LaneColumns) -> bool:
    if one == other:
        return True
    if one < 0 or other < 0:
        return False
    if lanes.left[one] == other or lanes.right[one] == other:
        return True
    for before, after in ((one, other), (other, one)):
        for k in range(lanes.first_successor[before], lanes.first_successor[before + 1]):
            if lanes.successor[k] == after:
                return True
    return False
