"""What is judged of a comparison and how strictly: in general, and as the file of a gate says it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.common.error_text import first_problem, shown
from harness.common.errors import InputError
from harness.common.untrusted_files import read_toml
from harness.scoring.metrics import closedloop
from harness.scoring.metrics.hidden_cost import COST, CRPS, FALSE_HIDDEN
from harness.scoring.metrics.in_plain_view import RECALL, WORST_TENTH
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import view

PRIMARY = ("mot.hota", COST, "occlusion.same_id_percent", CRPS, RECALL, WORST_TENTH)
COMPARED = (
    *(COST, CRPS, FALSE_HIDDEN, "mae.visible.lon_m", "mae.visible.speed_mps"),
    *("mae.partial.lon_m", "mae.hidden.lon_m", "mae.hidden.speed_mps", "hidden_outcomes", "occlusion.same_id_percent"),
    *("mot.hota", "mot.idf1", "mot_all.hota", "in_plain_view", "existence_calibration", "calibration.anees"),
    *("decisions", "pseudo_occlusion"),
)
IN_WORDS = {"mae.hidden.lon_m": {"label": "MAE hidden while followed, m"}}
STEP_TIME = Quantity("timing.tracker_ms.p50", "time of a step, ratio", decimals=1)
TOLERANCE, TIME_TOLERANCE = 0.02, 0.25
MOST_TOLERANCE, MOST_TIME_TOLERANCE = 1.0, 100.0
PARAMETER = "gate"


class Limit(BaseModel):
    """What is asked of one metric alone.

    Attributes:
        tolerance: Share of a's value by which b may be worse; None for that of all metrics.
        floor: What b's value may not be below; None for none.
        ceiling: What it may not be above; None for none.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    tolerance: float | None = Field(default=None, ge=0.0, le=MOST_TIME_TOLERANCE)
    floor: float | None = None
    ceiling: float | None = None

    def check(self, quantity: Quantity) -> None:
        """Refuse a metric without a better end, bounds that it can't reach, and a tolerance of more than its value."""
        if quantity.best is not None:
            raise InputError(f"`primary`: {quantity.key} is best {quantity.better}, so that it gets no verdict")
        bounds = [value for value in (self.floor, self.ceiling) if value is not None]
        if bounds != sorted(bounds) or any(not quantity.least <= value <= quantity.most for value in bounds):
            told = f"give a floor and a ceiling above it, from {quantity.least:g} to {quantity.most:g}"
            raise InputError(f"`gate`: {quantity.key}: {told}")
        if self.tolerance is not None and self.tolerance > 1.0 and quantity.key != STEP_TIME.key:
            raise InputError(f"`gate`: {quantity.key}: give a tolerance from 0 to 1, not {self.tolerance:g}")

    def breach(self, value: float, quantity: Quantity) -> str:
        """Return a sentence on how a value breaks the bounds; empty where it does not."""
        decimals = quantity.decimals + 1
        if self.floor is not None and value < self.floor:
            return f"{value:.{decimals}f} is below the floor of {self.floor:g}"
        if self.ceiling is not None and value > self.ceiling:
            return f"{value:.{decimals}f} is above the ceiling of {self.ceiling:g}"
        return ""


NO_LIMIT = Limit()


@dataclass(frozen=True)
class Rules:
    """What is judged, and how much worse it may be, as a share of A's value: in general, in time a step, and singly.

    Raises:
        InputError: A tolerance is not a number, or out of its range; or nothing is judged.
    """

    tolerance: float = TOLERANCE
    time_tolerance: float = TIME_TOLERANCE
    primary: tuple[str, ...] = PRIMARY
    limits: Mapping[str, Limit] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the tolerances."""
        _check_within("tolerance", self.tolerance, MOST_TOLERANCE)
        _check_within("time_tolerance", self.time_tolerance, MOST_TIME_TOLERANCE)
        if not self.primary:
            raise InputError("`primary` is empty, so that nothing is judged; for example `primary` mot.hota")

    def judges(self, quantity: Quantity) -> bool:
        """Return whether a metric gets a verdict."""
        return quantity.key in (*self.primary, STEP_TIME.key)

    @property
    def are_chosen(self) -> bool:
        """Whether somebody chose which metrics are judged."""
        return self.primary not in (PRIMARY, closedloop.PRIMARY)

    def names(self, metric: str) -> bool:
        """Return whether somebody chose a metric to be judged."""
        return metric in (self.primary if self.are_chosen else self.limits)

    def margin(self, quantity: Quantity, a: float) -> float:
        """Return by how much b may be worse."""
        usual = self.time_tolerance if quantity.key == STEP_TIME.key else self.tolerance
        own = self.limit(quantity).tolerance
        return (usual if own is None else own) * abs(a)

    def limit(self, quantity: Quantity) -> Limit:
        """Return what is asked of one metric alone."""
        return self.limits.get(quantity.key, NO_LIMIT)


def _check_within(parameter: str, value: object, most: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= most:
        raise InputError(f"`{parameter}`: give a share from 0 to {most:g}, such as 0.02, not {shown(value)}")


def compared_quantities(primary: Sequence[str] = PRIMARY, closed_loop: bool = False) -> list[Quantity]:
    """Return what is compared: what gets a verdict, then the rest; drives by belief have metrics of their own."""
    of_drives = [quantity for quantity in closedloop.QUANTITIES if quantity.key != closedloop.IMPACT]
    order = {key: place for place, key in enumerate(primary)}
    return sorted(
        of_drives if closed_loop else view(COMPARED, IN_WORDS), key=lambda quantity: order.get(quantity.key, len(order))
    )


def quantity_of(metric: str) -> Quantity:
    """Return the compared metric of a key."""
    known = (*compared_quantities(), *compared_quantities(closed_loop=True), *closedloop.QUANTITIES, STEP_TIME)
    return next(each for each in known if each.key == metric)


def name_of(metric: str) -> str:
    """Return a compared metric's label without its unit."""
    label = quantity_of(metric).label
    return label.rpartition(",")[0] or label


class Gate(BaseModel):
    """The requirements of a gate; without metrics the default ones are judged."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    tolerance: float = Field(default=TOLERANCE, ge=0.0, le=MOST_TOLERANCE)
    time_tolerance: float = Field(default=TIME_TOLERANCE, ge=0.0, le=MOST_TIME_TOLERANCE)
    allow_undecided: bool = False
    metrics: dict[str, Limit] = Field(default_factory=dict)

    def rules(self, tolerance: float | None, time_tolerance: float | None, primary: tuple[str, ...] | None) -> Rules:
        """Return the rules of a comparison; what is given goes before the file, None for what the file says.

        The file's own metrics are judged beside those that are given: no option takes away a requirement.
        """
        return Rules(
            self.tolerance if tolerance is None else tolerance,
            self.time_tolerance if time_tolerance is None else time_tolerance,
            tuple(self.metrics) or PRIMARY if primary is None else tuple(dict.fromkeys((*primary, *self.metrics))),
            self.metrics,
        )


def read_gate(path: Path | None) -> Gate:
    """Return the requirements in a file, or the defaults without a file."""
    if path is None:
        return Gate()
    try:
        return Gate.model_validate(read_toml(path, PARAMETER))
    except ValidationError as error:
        key, message, given, unknown = first_problem(error)
        problem = f"unknown key {key!r}" if unknown else f"{key}: {message}, not {given!r}"
        raise InputError(f"`{PARAMETER}`: {path}: {problem}; see docs/tutorials/gate.md") from None
