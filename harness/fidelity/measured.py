"""What was measured at a network's site: the figures of each period, which travel with the network.

The fields that they come from do not; ``measure`` makes the figures from them anew.
"""

from __future__ import annotations

import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.errors import InputError
from harness.fidelity.fields import Fields
from harness.fidelity.statistics import PeriodStatistics, period_statistics
from harness.truth.network.network import Network

PART_S = 300.0


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class MeasuredPeriod(_Strict):
    """One period of a site.

    Attributes:
        start_s: When it begins, seconds after the recording's begin.
        duration_s: How long it is.
        skip_s: How much of its begin is left out, of the simulated one too.
        statistics: Its figures.
        parts: Figures of each five minutes of it.
    """

    start_s: float = Field(ge=0.0)
    duration_s: float = Field(gt=0.0)
    skip_s: float = Field(ge=0.0)
    statistics: PeriodStatistics
    parts: tuple[PeriodStatistics, ...]


class MeasuredSite(_Strict):
    """The content of ``measured.toml``.

    Attributes:
        source: Where the measurements are published.
        periods: The periods by the demand that stands for each.
    """

    source: str
    periods: dict[str, MeasuredPeriod]

    def period(self, demand: str) -> MeasuredPeriod:
        """Return the period that a demand stands for.

        Raises:
            InputError: None was measured.
        """
        if demand not in self.periods:
            raise InputError(f"`demand` {demand}: nothing was measured for it; measured are: {', '.join(self.periods)}")
        return self.periods[demand]


def read_measured(network: Network) -> MeasuredSite:
    """Read what was measured at a network's site.

    Raises:
        InputError: The network has no measurements, or their file is broken.
    """
    path = network.measured_file
    if path is None:
        raise InputError(f"`net` {network.name}: it has no measured_file in its network.toml to be compared with")
    try:
        return MeasuredSite.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{path}: {'.'.join(str(part) for part in first['loc'])}: {first['msg']}") from error


def measure(site: MeasuredSite, fields: Fields, lanes: int) -> MeasuredSite:
    """Return the site with the figures of every period made anew from its fields.

    Raises:
        InputError: The fields end before the last period does.
    """
    ends = max(period.start_s + period.duration_s for period in site.periods.values())
    if fields.duration_s < ends:
        raise InputError(f"`fields`: they cover {fields.duration_s:g} s; the periods end at {ends:g} s")
    return site.model_copy(
        update={"periods": {name: _measure_period(entry, fields, lanes) for name, entry in site.periods.items()}}
    )


def write_measured(path: Path, site: MeasuredSite) -> None:
    """Write a site as ``measured.toml``."""
    import tomli_w  # noqa: PLC0415

    header = "# Made from the recorded fields by `python -m harness calibrate --fields ... --write`.\n\n"
    path.write_text(header + tomli_w.dumps(as_table(site)), encoding="utf-8")


def as_table(site: MeasuredSite) -> dict[str, Any]:
    """Return the site as the tables of ``measured.toml``, figures rounded to four digits after the point."""
    return {
        "source": site.source,
        "periods": {
            name: {
                "start_s": period.start_s,
                "duration_s": period.duration_s,
                "skip_s": period.skip_s,
                "statistics": _rounded(period.statistics),
                "parts": [_rounded(part) for part in period.parts],
            }
            for name, period in site.periods.items()
        },
    }


def _measure_period(period: MeasuredPeriod, fields: Fields, lanes: int) -> MeasuredPeriod:
    begin, end = period.start_s + period.skip_s, period.start_s + period.duration_s
    parts = []
    for k in range(round(period.duration_s / PART_S)):
        part = fields.between(max(begin, period.start_s + k * PART_S), period.start_s + (k + 1) * PART_S)
        parts.append(period_statistics([part], lanes))
    statistics = period_statistics([fields.between(begin, end)], lanes)
    return period.model_copy(update={"statistics": statistics, "parts": tuple(parts)})


def _rounded(statistics: PeriodStatistics) -> dict[str, Any]:
    def digits(value: float | tuple[float, ...]) -> float | list[float]:
        return [round(entry, 4) for entry in value] if isinstance(value, tuple) else round(value, 4)

    return {name: digits(value) for name, value in asdict(statistics).items()}
