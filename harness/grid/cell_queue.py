"""The queue of cells that wait for a worker; cells of the same traffic stay together."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from harness.grid.cells import Cell, CellTraffic


class CellQueue:
    """Hands out cells so that a worker reuses the traffic that it remembers where possible."""

    def __init__(self, cells: Iterable[Cell]) -> None:
        """Take in the cells; traffic is begun in their order."""
        self._new: dict[CellTraffic, deque[Cell]] = {}
        self._begun: dict[CellTraffic, deque[Cell]] = {}
        for cell in cells:
            self._new.setdefault(cell.traffic, deque()).append(cell)

    def __bool__(self) -> bool:
        return bool(self._new or self._begun)

    def take(self, remembered: CellTraffic | None) -> Cell:
        """Take the next cell: of the remembered traffic, else of traffic that no worker has begun, else any.

        Args:
            remembered: Traffic of the cell that the worker did last; None for a new one.

        Raises:
            ValueError: No cell waits.
        """
        traffic = remembered
        if traffic not in self._begun:
            if self._new:
                traffic = next(iter(self._new))
                self._begun[traffic] = self._new.pop(traffic)
            else:
                traffic = max(self._begun, key=lambda key: len(self._begun[key]))
        cells = self._begun[traffic]
        cell = cells.popleft()
        if not cells:
            del self._begun[traffic]
        return cell

    def put_back(self, cell: Cell) -> None:
        """Let a cell wait again, before the others of its traffic."""
        self._begun.setdefault(cell.traffic, deque()).appendleft(cell)
