"""Signals and right of way of a SUMO network's connections, for each link of its lane graph."""

from collections.abc import Mapping, Sequence

import numpy as np

from harness.truth.network.corridor import SumoConnection, SumoLane
from mmpf.map.control import FREE, NO_SIGNAL, SIGNAL, YIELD, LinkControl
from mmpf.numerics.arrays import IntArray

# SUMO's letters for links whose vehicles wait for others: minor roads, stop signs, nobody has right of way.
YIELDS = frozenset("msw=")

Junction = tuple[str, int]
"""A junction's name, and a link's number in its table of right of way."""


def read_control(
    lanes: Mapping[str, SumoLane], names: Sequence[str], successor: IntArray, first_successor: IntArray
) -> LinkControl:
    """Return what holds vehicles before each link.

    Who turns across oncoming traffic waits for it within the junction, where SUMO divides the path: it yields there
    and not at the line before the junction.
    """
    links = len(successor)
    kind, signal = np.full(links, FREE), np.full(links, NO_SIGNAL)
    signals: dict[str, int] = {}
    entry: dict[Junction, int] = {}
    foes: dict[int, list[Junction]] = {}
    origin = np.repeat(np.arange(len(names)), np.diff(first_successor))
    for k in range(links):
        connection = _connection(lanes[names[origin[k]]], names[successor[k]])
        if connection is None:
            continue
        if connection.getTLSID():
            name = f"{connection.getTLSID()}:{connection.getTLLinkIndex()}"
            kind[k], signal[k] = SIGNAL, signals.setdefault(name, len(signals))
        elif connection.getState() in YIELDS:
            kind[k] = YIELD
        number = connection.getJunctionIndex()
        if number >= 0:
            junction = connection.getJunction()
            entry[junction.getID(), number] = k
            row = junction._prohibits.get(number, "")
            foes[k] = [(junction.getID(), j) for j, mark in enumerate(reversed(row)) if mark == "1"]
    _wait_within(kind, foes, names, successor, first_successor)
    found = [[entry[foe] for foe in foes.get(k, []) if foe in entry] for k in range(links)]
    return LinkControl(
        kind=kind,
        signal=signal,
        signal_name=tuple(signals),
        foe=np.array([foe for each in found for foe in each], dtype=np.int64),
        first_foe=np.cumsum([0, *map(len, found)]),
    )


def _connection(lane: SumoLane, following: str) -> SumoConnection | None:
    ways = ((each, each.getViaLaneID(), each.getToLane().getID()) for each in lane.getOutgoing())
    return next((connection for connection, *names in ways if following in names), None)


def _wait_within(
    kind: IntArray, foes: dict[int, list[Junction]], names: Sequence[str], successor: IntArray, first: IntArray
) -> None:
    """Move the links with priority to the link within the junction where vehicles wait, if there is one; in place."""
    for k in list(foes):
        via = successor[k]
        if not names[via].startswith(":"):
            continue
        for inner in range(first[via], first[via + 1]):
            if kind[inner] == YIELD and names[successor[inner]].startswith(":"):
                foes[inner] = foes.pop(k)
                if kind[k] == YIELD:
                    kind[k] = FREE
                break
