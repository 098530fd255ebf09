"""The gate file: which metrics are judged, with which tolerances, floors and ceilings."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.analysis.verdicts import PRIMARY, TIME_TOLERANCE, TOLERANCE, Limit, Rules
from harness.common.error_text import first_problem
from harness.common.errors import InputError
from harness.config.layers import table_of_file

PARAMETER = "gate"


class MetricGate(BaseModel):
    """What is asked of one metric."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    tolerance: float | None = Field(default=None, ge=0.0, le=100.0)
    floor: float | None = None
    ceiling: float | None = None


class Gate(BaseModel):
    """The requirements of a gate; without metrics the default ones are judged."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    tolerance: float = Field(default=TOLERANCE, ge=0.0, le=1.0)
    time_tolerance: float = Field(default=TIME_TOLERANCE, ge=0.0, le=100.0)
    allow_undecided: bool = False
    metrics: dict[str, MetricGate] = Field(default_factory=dict)

    def rules(self, tolerance: float | None, time_tolerance: float | None, primary: tuple[str, ...] | None) -> Rules:
        """Return the rules of a comparison.

        Args:
            tolerance: Goes before that of the file; None for that.
            time_tolerance: Likewise.
            primary: Likewise, of the metrics that are judged.
        """
        return Rules(
            self.tolerance if tolerance is None else tolerance,
            self.time_tolerance if time_tolerance is None else time_tolerance,
            primary if primary is not None else tuple(self.metrics) or PRIMARY,
            {key: Limit(each.tolerance, each.floor, each.ceiling) for key, each in self.metrics.items()},
        )


def read_gate(path: Path | None) -> Gate:
    """Return the requirements in a file, or the defaults without a file.

    Raises:
        InputError: It can't be read, or asks for something that there is not.
    """
    if path is None:
        return Gate()
    try:
        return Gate.model_validate(table_of_file(path, PARAMETER))
    except ValidationError as error:
        key, message, given, unknown = first_problem(error)
        problem = f"unknown key {key!r}" if unknown else f"{key}: {message}, not {given!r}"
        raise InputError(f"`{PARAMETER}`: {path}: {problem}; see docs/tutorials/gate.md") from None
