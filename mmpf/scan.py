"""The tracker's input: a scan of detections, the sensor's pose, and the sensor's data sheet.

Nothing here says which vehicle a detection came from.
"""

from dataclasses import dataclass, fields

import numpy as np

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

VEHICLE_CLASSES = ("unknown", "car", "truck", "bus", "trailer", "motorcycle")
"""Classes of vehicles by their codes; vans are cars, pickups and construction vehicles are trucks."""
SHORTEST_STEP_S = 1e-3  # scans closer in time are repeated ones
UNKNOWN_CLASS, CAR, TRUCK, BUS, TRAILER, MOTORCYCLE = range(len(VEHICLE_CLASSES))


class InvalidScanError(ValueError):
    """A scan that no sensor can have made: non-finite or mismatched values, or time that runs backwards."""


@dataclass(frozen=True)
class BodySizes:
    """Sizes of the boxes fitted to d detected vehicles, struct of arrays; each of shape (d,), metres, positive.

    Attributes:
        length_m: Measured length.
        width_m: Measured width.
        std_length_m: Standard deviation of the length, as the sensor reports it.
        std_width_m: Standard deviation of the width, likewise.
    """

    length_m: FloatArray
    width_m: FloatArray
    std_length_m: FloatArray
    std_width_m: FloatArray

    def validate(self, count: int) -> None:
        """Check the arrays for their shape and for values that no measurement has.

        Raises:
            InvalidScanError: A shape is not (count,), or a value is not finite or not positive.
        """
        _check_finite("sizes", self, count)
        for column in fields(self):
            if (getattr(self, column.name) <= 0.0).any():
                raise InvalidScanError(f"detections.sizes.{column.name} must be positive")


@dataclass(frozen=True)
class BodyHeadings:
    """Directions of the boxes fitted to d detected vehicles in the plane, struct of arrays; each of shape (d,).

    Attributes:
        heading_rad: Measured direction against the frame's longitudinal axis, radians.
        std_rad: Standard deviation of it where the front is taken for the front, as the sensor reports it; positive.
        flip_probability: Probability that the front is taken for the back, 0 to 1.
    """

    heading_rad: FloatArray
    std_rad: FloatArray
    flip_probability: FloatArray

    def validate(self, count: int) -> None:
        """Check the arrays for their shape and for values that no measurement has.

        Raises:
            InvalidScanError: A shape is not (count,), a value is not finite, a deviation not positive, or a probability
                not one.
        """
        _check_finite("headings", self, count)
        if (self.std_rad <= 0.0).any():
            raise InvalidScanError("detections.headings.std_rad must be positive")
        if ((self.flip_probability < 0.0) | (self.flip_probability > 1.0)).any():
            raise InvalidScanError("detections.headings.flip_probability must lie between 0 and 1")


@dataclass(frozen=True)
class Detections:
    """The d detections of one scan in the road frame, struct of arrays, each of shape (d,); their order means nothing.

    Attributes:
        lon_m: Measured longitudinal position of the vehicle's centre, metres.
        lat_m: Measured lateral position of the vehicle's centre, metres.
        speed_mps: Measured longitudinal speed, m/s; nan where the sensor does not measure it.
        std_lon_m: Standard deviation of the longitudinal noise, metres, as the sensor reports it; positive.
        std_lat_m: Standard deviation of the lateral noise, metres; positive.
        std_speed_mps: Standard deviation of the speed noise, m/s; nan where speed is not measured.
        sizes: Measured sizes, of shape (d,); None of a sensor that measures none.
        headings: Measured directions, of shape (d,); None of a sensor that measures none. A tracker may use them where
            the road frame is the plane and no lanes are known.
        correlation: Correlation of the longitudinal and the lateral noise, between -1 and 1, which with the deviations
            makes a covariance, shape (d,); None of a sensor that does not tell, whose noises are taken for independent.
        score: How sure the detector is, shape (d,), above 0 and below 1: the probability that the detection is of a
            vehicle, if true and false ones were equally frequent; None of a detector that gives none.
        vehicle_class: Code of the class that the detector takes each for, see ``VEHICLE_CLASSES``, shape (d,); None of
            a detector that gives none.
    """

    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    std_lon_m: FloatArray
    std_lat_m: FloatArray
    std_speed_mps: FloatArray
    sizes: BodySizes | None = None
    headings: BodyHeadings | None = None
    correlation: FloatArray | None = None
    score: FloatArray | None = None
    vehicle_class: IntArray | None = None

    def __len__(self) -> int:
        return len(self.lon_m)

    @property
    def odds(self) -> FloatArray:
        """How many times likelier each score is of a vehicle than of nothing, shape (d,); 1 without scores."""
        return np.ones(len(self)) if self.score is None else np.asarray(self.score / (1.0 - self.score))

    @property
    def covariance_m2(self) -> FloatArray:
        """Covariance of each position's noise, square metres, shape (d, 2, 2)."""
        both = np.zeros(len(self)) if self.correlation is None else self.correlation
        both = both * self.std_lon_m * self.std_lat_m
        rows = np.stack([self.std_lon_m**2, both, both, self.std_lat_m**2], axis=-1)
        return np.asarray(rows.reshape(-1, 2, 2))

    def validate(self) -> None:
        """Check the arrays against each other and for values that no measurement has.

        Raises:
            InvalidScanError: Shapes differ, a position, size or deviation is not finite, or a size or deviation is not
                positive.
        """
        for name in ("lon_m", "lat_m", "speed_mps", "std_lon_m", "std_lat_m", "std_speed_mps"):
            values = getattr(self, name)
            if values.shape != self.lon_m.shape or values.ndim != 1:
                raise InvalidScanError(f"detections.{name} has shape {values.shape}, not {self.lon_m.shape}")
        for name in ("lon_m", "lat_m", "std_lon_m", "std_lat_m"):
            if not np.isfinite(getattr(self, name)).all():
                raise InvalidScanError(f"detections.{name} holds a value that is not finite")
        if np.isinf(self.speed_mps).any() or np.isinf(self.std_speed_mps).any():
            raise InvalidScanError("detections.speed_mps or std_speed_mps is infinite; use nan for 'not measured'")
        if (np.isfinite(self.speed_mps) & ~np.isfinite(self.std_speed_mps)).any():
            raise InvalidScanError("detections.speed_mps is measured but its std_speed_mps is nan")
        for name in ("std_lon_m", "std_lat_m", "std_speed_mps"):
            if (getattr(self, name) <= 0.0).any():
                raise InvalidScanError(f"detections.{name} must be positive")
        if self.sizes is not None:
            self.sizes.validate(len(self))
        if self.headings is not None:
            self.headings.validate(len(self))
        _check_between("correlation", self.correlation, len(self), -1)
        _check_between("score", self.score, len(self), 0)
        _check_between("vehicle_class", self.vehicle_class, len(self), -1, len(VEHICLE_CLASSES))


def _check_finite(name: str, rows: BodySizes | BodyHeadings, count: int) -> None:
    for column in fields(rows):
        values = getattr(rows, column.name)
        if values.shape != (count,):
            raise InvalidScanError(f"detections.{name}.{column.name} has shape {values.shape}, not {(count,)}")
        if not np.isfinite(values).all():
            raise InvalidScanError(f"detections.{name}.{column.name} holds a value that is not finite")


def _check_between(name: str, values: FloatArray | IntArray | None, count: int, least: int, most: int = 1) -> None:
    if values is None:
        return
    if values.shape != (count,):
        raise InvalidScanError(f"detections.{name} has shape {values.shape}, not {(count,)}")
    if not ((values > least) & (values < most)).all():
        raise InvalidScanError(f"detections.{name} must lie between {least} and {most}, both left out")


@dataclass(frozen=True)
class EgoPose:
    """Where the sensor's vehicle is, in the road frame; the sensor sits on its centre.

    Attributes:
        lon_m: Longitudinal position of the centre, metres.
        lat_m: Lateral position of the centre, metres.
        heading_rad: Heading against the road's direction, radians, positive to the left.
        speed_mps: Longitudinal speed, m/s.
        length_m: Length of the vehicle, metres.
        width_m: Width of the vehicle, metres.
    """

    lon_m: float
    lat_m: float
    heading_rad: float
    speed_mps: float
    length_m: float
    width_m: float


@dataclass(frozen=True)
class FreeSpace:
    """How far the sensor can see in each direction, worked out from its own detections alone.

    Attributes:
        range_m: Free distance per bearing sector, metres, shape (sectors,). Sector ``k`` spans the bearings
            ``[-pi + k * width, -pi + (k + 1) * width)`` with ``width = 2 pi / sectors``, Cartesian, counter-clockwise.
            Beyond that distance the sector lies in a detected vehicle's shadow; a free sector has the sensor's range.
    """

    range_m: FloatArray


@dataclass(frozen=True)
class Scan:
    """All that a tracker receives at one time step.

    Attributes:
        time_s: Time of the scan, seconds; grows from scan to scan.
        detections: The detections, d of them, which may be none.
        ego: Pose of the sensor's vehicle at that time.
        free_space: What the sensor knows of its own shadows; None if it does not say.
        open_signals: Whether each signal of the map lets vehicles go, shape (signals,), in the order of
            ``LinkControl.signal_name``; None where the tracker is not told, as by default.
    """

    time_s: float
    detections: Detections
    ego: EgoPose
    free_space: FreeSpace | None = None
    open_signals: BoolArray | None = None


@dataclass(frozen=True)
class SensorModel:
    """What a tracker may know of the sensor beforehand: its data sheet.

    Attributes:
        range_m: Nothing beyond this distance is detected, metres.
        detection_probability: Probability of detecting a vehicle in plain view, 0 to 1.
        clutter_per_scan: Expected number of false detections a scan.
        full_view_fraction: Visible fraction, 0 to 1, from which the detection probability is the full one; below it
            the probability falls in proportion.
        hidden_fraction: Visible fraction, 0 to 1, below which a vehicle gives no detection.
        clutter_area_m2: Area over which clutter spreads evenly, square metres.
        clutter_speed_span_mps: Span over which the speeds of false detections spread evenly, m/s, where speed is
            measured.
        noise_correlated_share: Share of the noise's variance, 0 to 1, that drifts from scan to scan.
        noise_correlation_s: Time constant with which it drifts, seconds.
        class_accuracy: Probability, 0 to 1, that the class of a detected vehicle is right; 0 if it is not known.

    Raises:
        ValueError: A value is not finite or out of its bounds.
    """

    range_m: float = 100.0
    detection_probability: float = 0.95
    clutter_per_scan: float = 1.0
    full_view_fraction: float = 0.7
    hidden_fraction: float = 0.15
    clutter_area_m2: float = 4000.0
    clutter_speed_span_mps: float = 40.0
    noise_correlated_share: float = 0.0
    noise_correlation_s: float = 0.0
    class_accuracy: float = 0.0

    def __post_init__(self) -> None:
        for column in fields(self):
            value = getattr(self, column.name)
            if not np.isfinite(value):
                raise ValueError(f"sensor {column.name} is {value}, not a finite number")
        for name in ("range_m", "clutter_area_m2", "clutter_speed_span_mps"):
            if getattr(self, name) <= 0.0:
                raise ValueError(f"sensor {name} is {getattr(self, name)}; it must be positive")
        for name in ("clutter_per_scan", "noise_correlation_s"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"sensor {name} is {getattr(self, name)}; it must not be negative")
        shares = "detection_probability", "full_view_fraction", "hidden_fraction", "noise_correlated_share"
        for name in (*shares, "class_accuracy"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"sensor {name} is {getattr(self, name)}; it must lie between 0 and 1")
        if self.hidden_fraction >= self.full_view_fraction:
            raise ValueError(
                f"sensor hidden_fraction is {self.hidden_fraction}; it must be below full_view_fraction, "
                f"{self.full_view_fraction}"
            )

    @property
    def clutter_density_per_m2(self) -> float:
        """Expected clutter per square metre and scan; never zero, so that likelihood ratios stay finite."""
        return max(self.clutter_per_scan, 1e-3) / self.clutter_area_m2


def check_scan(scan: Scan, previous_time_s: float | None, signals: int | None = None) -> None:
    """Refuse a scan that no sensor can have made, or that does not follow the previous one.

    Args:
        scan: The scan.
        previous_time_s: Time of the scan before it; None at the first.
        signals: How many signals the map has; None if that is not known.

    Raises:
        InvalidScanError: The time is not finite or not after the previous one, the ego's pose is not finite,
            the detections are impossible (``Detections.validate``), or states of other signals are told than there are.
    """
    if not np.isfinite(scan.time_s):
        raise InvalidScanError(f"scan.time_s is {scan.time_s}, not a finite time")
    if previous_time_s is not None and round(scan.time_s - previous_time_s, 6) < SHORTEST_STEP_S:
        least = f"less than {SHORTEST_STEP_S:g} s after the last scan's {previous_time_s}"
        raise InvalidScanError(f"scan.time_s is {scan.time_s}, {least}")
    for column in fields(scan.ego):
        if not np.isfinite(getattr(scan.ego, column.name)):
            raise InvalidScanError(f"scan.ego.{column.name} is not finite")
    scan.detections.validate()
    told = scan.open_signals
    if signals is not None and told is not None and told.shape != (signals,):
        raise InvalidScanError(f"scan.open_signals has shape {told.shape}, but the map has {signals} signals")
