"""The ego and the vehicles around it at each step, true or believed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, taken


@dataclass(frozen=True)
class Bodies:
    """Vehicles other than the ego at all steps, struct of arrays of shape (m,), centres in the road frame.

    Attributes:
        step: Index of the step among those of the egos.
        speed_mps: Speed: along the road, or on a road in the plane along the body's own direction.
        direction_rad: In the plane, where it is heading; nan where that is not known.
        doubtful: Whether it is more likely no vehicle than one; None where all are sure.
    """

    step: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    direction_rad: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    doubtful: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.step)

    @property
    def has_doubtful(self) -> bool:
        """Whether there is a doubtful one."""
        return self.doubtful is not None and bool(self.doubtful.any())

    def sure(self) -> Bodies:
        """Return those that are not doubtful, in the same order."""
        return self if self.doubtful is None else replace(taken(self, ~self.doubtful), doubtful=None)


@dataclass(frozen=True)
class Egos:
    """The ego at each step, struct of arrays of shape (n,); its own state is known in every belief.

    Attributes:
        episode: Its stay; a new ego begins a new one.
        lane: Number of its lane as in the truth, 0 off every lane.
        route: Indices of the lanes that its way goes by, of a driver's who is asked before it has driven it.
    """

    episode: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    lane: IntArray
    length_m: FloatArray
    width_m: FloatArray
    route: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.episode)
