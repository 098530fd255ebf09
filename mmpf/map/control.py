"""Signals and right of way where lanes meet."""

from dataclasses import dataclass

import numpy as np

from mmpf.numerics.arrays import IntArray

FREE, YIELD, SIGNAL = range(3)
"""Kinds of links: none must wait, or for those who have right of way, or for a signal."""
NO_SIGNAL = -1


@dataclass(frozen=True)
class LinkControl:
    """What holds vehicles before each link, struct of arrays over the k links of a graph.

    A link leads from a lane to one that follows; links are in the order of ``LaneGraph.successor``. Vehicles wait
    for it at the end of the lane that it leads from: there is the stop line.

    Attributes:
        kind: ``FREE``, ``YIELD`` or ``SIGNAL``, shape (k,).
        signal: Number of each link's signal, ``NO_SIGNAL`` where there is none, shape (k,).
        signal_name: What each signal is called.
        foe: Links whose vehicles go first or cross, of all links one after the other, shape (f,).
        first_foe: Where each link's begin, and the end of the last, shape (k + 1,).

    Raises:
        ValueError: Shapes don't fit, or an index leads nowhere.
    """

    kind: IntArray
    signal: IntArray
    signal_name: tuple[str, ...]
    foe: IntArray
    first_foe: IntArray

    def __post_init__(self) -> None:
        links = len(self.kind)
        if self.kind.shape != (links,) or self.signal.shape != (links,) or self.first_foe.shape != (links + 1,):
            raise ValueError("link control: kind, signal and first_foe do not have a place for each link")
        if self.first_foe[0] != 0 or self.first_foe[-1] != len(self.foe) or (np.diff(self.first_foe) < 0).any():
            raise ValueError("link control: first_foe does not divide foe up by links")
        highest = ((self.kind, FREE, SIGNAL), (self.foe, 0, links - 1))
        for values, low, high in (*highest, (self.signal, NO_SIGNAL, len(self.signal_name) - 1)):
            if len(values) and (values.min() < low or values.max() > high):
                raise ValueError("link control: a kind, foe or signal is none")
        if ((self.kind == SIGNAL) != (self.signal != NO_SIGNAL)).any():
            raise ValueError("link control: a link with a signal must be of the kind SIGNAL, and no other")
