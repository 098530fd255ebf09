"""Measurements at a network's site for each period; they are stored with the network.

The fields that they come from do not; ``measure`` makes the figures from them anew.
"""

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from harness.common.errors import InputError
from harness.lab.fidelity.fields import Fields
from harness.lab.fidelity.samples import VehicleStatistics, recorded_samples, recording_files
from harness.lab.fidelity.statistics import PeriodStatistics, period_statistics
from harness.truth.network.demand import NetworkTable
from harness.truth.network.network import Network
from harness.truth.network.networkfile import file_of

PART_S = 300.0
MEASURED_COMMENT = "Made from recordings by `python -m harness calibrate --fields ... --recordings ... --write`."


class MeasuredPeriod(NetworkTable):
    """One period of a site.

    Attributes:
        start_s: When it begins, seconds after the recording's begin.
        skip_s: How much of its begin is left out, of the simulated one too.
        parts: Figures of each five minutes of it.
    """

    start_s: float = Field(ge=0.0)
    duration_s: float = Field(gt=0.0)
    skip_s: float = Field(ge=0.0)
    statistics: PeriodStatistics
    parts: tuple[PeriodStatistics, ...]


class MeasuredVehicles(NetworkTable):
    """What single vehicles of a site do, and which recordings that is taken from."""

    source: str
    figures: VehicleStatistics


class MeasuredSite(NetworkTable):
    """The content of ``measured.toml``.

    Attributes:
        periods: The periods by the demand that stands for each.
    """

    source: str
    vehicles: MeasuredVehicles | None = None
    periods: dict[str, MeasuredPeriod]

    def period(self, demand: str) -> MeasuredPeriod:
        """Return the period that a demand stands for."""
        if demand not in self.periods:
            raise InputError(f"`demand` {demand}: nothing was measured for it; measured are: {', '.join(self.periods)}")
        return self.periods[demand]


def read_measured(network: Network) -> MeasuredSite:
    """Read what was measured at a network's site.

    Raises:
        InputError: The network has no measurements, or their file is broken.
    """
    if (path := network.measured_file) is None:
        raise InputError(f"`net` {network.name}: it has no measured_file in its network.toml to be compared with")
    return file_of(path, MeasuredSite)


def measure(site: MeasuredSite, fields: Fields, lanes: int) -> MeasuredSite:
    """Return the site with the figures of every period recomputed from its fields.

    Raises:
        InputError: The fields end before the last period does.
    """
    ends = max(period.start_s + period.duration_s for period in site.periods.values())
    if fields.duration_s < ends:
        raise InputError(f"`fields`: they cover {fields.duration_s:g} s; the periods end at {ends:g} s")
    return site.model_copy(
        update={"periods": {name: _measure_period(entry, fields, lanes) for name, entry in site.periods.items()}}
    )


def measure_vehicles(site: MeasuredSite, recordings: Sequence[Path], net: str) -> MeasuredSite:
    """Return the site with the figures of its vehicles recomputed from recordings; unchanged without any."""
    if not (files := recording_files(recordings)):
        return site
    figures = recorded_samples(files, net).statistics()
    source = "NGSIM US-101 in " + ", ".join(file.name for file in files)
    return site.model_copy(update={"vehicles": MeasuredVehicles(source=source, figures=figures)})


def _measure_period(period: MeasuredPeriod, fields: Fields, lanes: int) -> MeasuredPeriod:
    begin, end = period.start_s + period.skip_s, period.start_s + period.duration_s
    parts = []
    for k in range(round(period.duration_s / PART_S)):
        part = fields.between(max(begin, period.start_s + k * PART_S), period.start_s + (k + 1) * PART_S)
        parts.append(period_statistics([part], lanes))
    statistics = period_statistics([fields.between(begin, end)], lanes)
    return period.model_copy(update={"statistics": statistics, "parts": tuple(parts)})
