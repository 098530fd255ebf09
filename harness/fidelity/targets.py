"""How near to the measured traffic the simulated one has to be, and whether it is."""

from __future__ import annotations

from dataclasses import dataclass

from harness.fidelity.statistics import PeriodStatistics

MEAN_PERCENT = 5.0
QUARTER_PERCENT = 10.0
SLOW_POINTS = 3.0
WAVE_PERCENT = 20.0


@dataclass(frozen=True)
class Target:
    """One figure that has to be met.

    Attributes:
        name: What is compared.
        simulated: The simulated figure.
        measured: The measured one.
        error: By how much the simulated one is off, in the tolerance's unit.
        tolerance: By how much it may be off.
        unit: ``%`` of the measured figure, or percentage ``points``.
    """

    name: str
    simulated: float
    measured: float
    error: float
    tolerance: float
    unit: str

    @property
    def met(self) -> bool:
        """Whether the figure is within its tolerance; a figure that is not a number is not."""
        return abs(self.error) <= self.tolerance


def targets(simulated: PeriodStatistics, measured: PeriodStatistics) -> tuple[Target, ...]:
    """Compare a simulated period with the measured one."""

    def relative(name: str, first: float, second: float, tolerance: float) -> Target:
        return Target(name, first, second, 100.0 * (first / second - 1.0), tolerance, "%")

    slow, measured_slow = 100.0 * simulated.share_below_4mps, 100.0 * measured.share_below_4mps
    return (
        relative("mean speed, m/s", simulated.mean_speed_mps, measured.mean_speed_mps, MEAN_PERCENT),
        relative("flow, veh/h", simulated.flow_veh_per_h, measured.flow_veh_per_h, MEAN_PERCENT),
        relative(
            "density, veh/km/lane", simulated.density_veh_per_km_lane, measured.density_veh_per_km_lane, MEAN_PERCENT
        ),
        *(
            relative(f"speed in quarter {k}, m/s", first, second, QUARTER_PERCENT)
            for k, (first, second) in enumerate(
                zip(simulated.quarter_speed_mps, measured.quarter_speed_mps, strict=True), start=1
            )
        ),
        Target("cells below 4 m/s, %", slow, measured_slow, slow - measured_slow, SLOW_POINTS, "points"),
        relative("wave speed, m/s", simulated.wave_mps, measured.wave_mps, WAVE_PERCENT),
    )
