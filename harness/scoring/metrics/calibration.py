"""Whether the trackers' standard deviations agree with their errors.

Deviations are along the frame's axes, and so are the errors that they are held against. Turning them into each
vehicle's direction would take the correlation of the two axes, which tracks do not report: an honest tracker that knows
a car on a diagonal road to 4 m along and 0.5 m across reports 2.9 m for both axes, which is right of them and of no
other direction.
"""

from dataclasses import dataclass, field

import numpy as np

from harness.scoring.evidence.directions import along_axes
from harness.scoring.evidence.errors import scored_rows
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import ROWS, of_any, of_whole
from harness.scoring.metrics.quantity import Quantity
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NORMAL_95 = 1.959963984540054
"""Half width of the standard normal's central 95 % interval."""
QUANTITIES = (
    Quantity(
        "calibration.anees.visible", "ANEES of tracks in view (1 is right)",
        decimals=2, heading="ANEES in view", best=1.0, weight="calibration.visible.n",
    ),
    Quantity(
        "calibration.anees.hidden", "ANEES of hidden tracks (1 is right)",
        decimals=2, heading="ANEES hidden", best=1.0, weight="calibration.hidden.n",
    ),
)  # fmt: skip
ERRORS = ["lon_error_m", "lat_error_m", "speed_error_mps"]
DEVIATIONS = ["std_lon_m", "std_lat_m", "std_speed_mps"]


@dataclass(frozen=True)
class CalibrationPart:
    """How the errors of followed vehicles in a stretch compare with their deviations.

    ``nees`` is that of each estimate that has a deviation, shape (n,). ``inside`` counts errors within 1.96 deviations,
    of vehicles that are not hidden and of those that are, shape (2, 3); ``usable`` those that have a deviation.
    """

    inside: IntArray
    usable: IntArray
    nees: FloatArray = field(metadata=ROWS)
    hidden: BoolArray = field(metadata=ROWS)


def measure_calibration(evidence: Evidence) -> CalibrationPart:
    """Measure a stretch."""
    error, std = (evidence.error_table[columns].to_numpy(dtype=np.float64) for columns in (ERRORS, DEVIATIONS))
    if evidence.rows.truth.direction_rad.any():
        kept = scored_rows(evidence.rows, evidence.history)
        direction = evidence.rows.truth.direction_rad[kept]
        error = np.column_stack([*along_axes(error[:, 0], error[:, 1], direction), error[:, 2]])
    followed, hidden = evidence.errors.tracked, evidence.errors.state == HIDDEN
    return compare_deviations(error[followed], std[followed], hidden[followed])


@of_whole
def calibration_by_visibility(part: CalibrationPart) -> dict[str, object]:
    """Return the calibration over all followed vehicles, and of the (partly) ``visible`` and ``hidden`` among them.

    Returns:
        ``nees``: normalised estimation error squared over longitudinal position, lateral position and speed, divided by
        the number of them that have a deviation (Bar-Shalom et al. 2001, section 5.4.2): 1 is right, above is
        over-confident. Tracks report a variance for each axis alone, so errors of different axes are taken as
        uncorrelated. ``nees_median``: its median, which a few far-off tracks do not move; an honest filter's is 0.789
        (a third of the median of a chi-square with 3 degrees of freedom). ``coverage95``: percent of errors within 1.96
        standard deviations, of each quantity. ``n``: number of estimates. ``anees``: the mean ``nees`` of the two side
        by side. nan without estimates.
    """
    nees, hidden, inside, usable = part.nees, part.hidden, part.inside, part.usable
    visible_and_hidden = {
        "visible": _calibrated(nees[~hidden], inside[0], usable[0]),
        "hidden": _calibrated(nees[hidden], inside[1], usable[1]),
    }
    anees = {name: table["nees"] for name, table in visible_and_hidden.items()}
    return _calibrated(nees, inside.sum(axis=0), usable.sum(axis=0)) | visible_and_hidden | {"anees": anees}


def compare_deviations(error: FloatArray, std: FloatArray, hidden: BoolArray) -> CalibrationPart:
    """Compare errors with their claimed deviations.

    Args:
        error: Errors of longitudinal position, lateral position and speed, shape (n, 3).
        std: Their claimed standard deviations, shape (n, 3); an error whose deviation is nan or not positive is left
            out.
        hidden: Whether the vehicle is hidden, shape (n,).
    """
    usable = np.isfinite(error) & np.isfinite(std) & (std > 0.0)
    scaled = np.abs(np.divide(error, std, out=np.full_like(error, np.nan), where=usable))
    known = usable.sum(axis=1)
    some = known > 0
    nees = np.nansum(scaled[some] ** 2, axis=1) / known[some]
    inside = (scaled <= NORMAL_95) & usable
    return CalibrationPart(
        nees=nees,
        hidden=hidden[some],
        inside=np.stack([inside[~hidden].sum(axis=0), inside[hidden].sum(axis=0)]),
        usable=np.stack([usable[~hidden].sum(axis=0), usable[hidden].sum(axis=0)]),
    )


def _calibrated(nees: FloatArray, inside: IntArray, usable: IntArray) -> dict[str, object]:
    share = np.divide(100.0 * inside, usable, out=np.full(3, np.nan), where=usable > 0)
    return {
        "nees": of_any(np.mean, nees),
        "nees_median": of_any(np.median, nees),
        "coverage95": dict(zip(("lon", "lat", "speed"), share.tolist(), strict=True)),
        "n": len(nees),
    }
