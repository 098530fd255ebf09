"""Measurement noise: position errors in the road frame, and speed from a range rate.

A box has errors along and across its own axis and along and across the line of sight. On a road its axis is the road's;
where the road frame is the plane it is the vehicle's own heading.
"""

from dataclasses import dataclass

import numpy as np

from harness.config.sensor import SensorSettings
from mmpf.numerics.arrays import FloatArray

# A range rate says nothing of the motion across the line of sight; this is how fast vehicles drift across their lane.
TYPICAL_LAT_SPEED_MPS = 0.35
SMALLEST_BOX_M = 0.3
LEAST_COSINE = np.cos(np.deg2rad(60.0))
"""The range rate yields a speed if the line of sight is within 60 degrees of the box's axis."""
REPORTED_VIEW = 0.25
"""Exponent with which the true growth of the noise of hidden vehicles appears in the reported deviation."""


@dataclass(frozen=True)
class PositionStd:
    """Standard deviations of measured positions, metres, each of shape (n,).

    Attributes:
        fit_lon_m: Error of the fitted box along its axis.
        lon_m: All of them together, longitudinal.
        correlation: Correlation of ``lon_m`` and ``lat_m``, -1 to 1.
    """

    fit_lon_m: FloatArray
    fit_lat_m: FloatArray
    along_m: FloatArray
    across_m: FloatArray
    lon_m: FloatArray
    lat_m: FloatArray
    correlation: FloatArray


def position_std(
    settings: SensorSettings,
    distance_m: FloatArray,
    angle_rad: FloatArray,
    visible_fraction: FloatArray,
    axis_rad: FloatArray | float = 0.0,
) -> PositionStd:
    """Return how precisely vehicles are measured.

    Args:
        settings: The sensor's figures.
        distance_m: Distance from the sensor, shape (n,).
        angle_rad: Direction of the line of sight against the box's axis, shape (n,).
        visible_fraction: How much of each is seen, shape (n,).
        axis_rad: Direction of the box's axis against the frame's, shape (n,); zero on a road.
    """
    factor = box_factor(settings, visible_fraction)
    fit_lon, fit_lat = factor * settings.std_lon_m, factor * settings.std_lat_m
    along = factor * np.hypot(settings.std_range_m, settings.std_range_share * distance_m)
    across = factor * np.deg2rad(settings.std_bearing_deg) * distance_m
    cosine, sine = np.cos(angle_rad + axis_rad), np.sin(angle_rad + axis_rad)
    turn, aside = np.cos(axis_rad), np.sin(axis_rad)
    fit = (fit_lon * turn) ** 2 + (fit_lat * aside) ** 2, (fit_lon * aside) ** 2 + (fit_lat * turn) ** 2
    lon = np.sqrt(fit[0] + (along * cosine) ** 2 + (across * sine) ** 2)
    lat = np.sqrt(fit[1] + (along * sine) ** 2 + (across * cosine) ** 2)
    both = (fit_lon**2 - fit_lat**2) * turn * aside + (along**2 - across**2) * cosine * sine
    return PositionStd(fit_lon, fit_lat, along, across, lon, lat, both / (lon * lat))


def hidden_share(settings: SensorSettings, visible_fraction: FloatArray) -> FloatArray:
    """Return 0 for vehicles in plain view, 1 at the edge of being hidden and beyond, linear between; shape (n,)."""
    span = settings.full_view_fraction - settings.hidden_fraction
    return np.asarray(np.clip((settings.full_view_fraction - visible_fraction) / span, 0.0, 1.0))


def box_factor(settings: SensorSettings, visible_fraction: FloatArray) -> FloatArray:
    """Return by how much the errors of a box grow for what is hidden of its vehicle, shape (n,)."""
    share = hidden_share(settings, visible_fraction)
    return np.asarray(1.0 + (settings.hidden_noise_factor - 1.0) * share)


def reported_factors(settings: SensorSettings, visible_fraction: FloatArray, normals: FloatArray) -> FloatArray:
    """Return by what detections multiply the deviations in plain view that they report, shape (n, 5).

    The columns are longitudinal, lateral, speed, length and width. A detector knows its own error badly: what it
    reports spreads from detection to detection and tells little of how much of the vehicle was seen.

    Args:
        settings: The sensor's figures.
        visible_fraction: How much of each vehicle is seen, shape (n,).
        normals: Standard normal numbers, shape (n, 6).
    """
    seen = box_factor(settings, visible_fraction) ** REPORTED_VIEW
    spread = settings.reported_spread * (normals[:, :1] + 0.5 * normals[:, 1:])
    return np.asarray(settings.reported_factor * seen[:, None] * np.exp(spread))


def measured_sizes(
    settings: SensorSettings,
    length_m: FloatArray,
    width_m: FloatArray,
    visible_fraction: FloatArray,
    normals: FloatArray,
) -> FloatArray:
    """Return rows of measured length and width and their deviations, shape (n, 4); nan where sizes are not measured.

    Args:
        settings: The sensor's figures.
        length_m: True lengths, shape (n,).
        width_m: True widths, shape (n,).
        visible_fraction: How much of each vehicle is seen, shape (n,).
        normals: Standard normal numbers, shape (n, 2).
    """
    if settings.std_length_m is None or settings.std_width_m is None:
        return np.full((len(length_m), 4), np.nan)
    size = np.stack([length_m, width_m], axis=-1)
    # In metres and not in proportion to the true size, which the deviation would give away.
    std = box_factor(settings, visible_fraction)[:, None] * np.array([settings.std_length_m, settings.std_width_m])
    return np.concatenate([np.maximum(size + std * normals, SMALLEST_BOX_M), std], axis=-1)


def position_error(std: PositionStd, angle_rad: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return errors along and across the boxes' axes, each (n,), made from standard normal numbers, shape (n, 4)."""
    along, across = std.along_m * normals[:, 2], std.across_m * normals[:, 3]
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    lon = std.fit_lon_m * normals[:, 0] + along * cosine - across * sine
    lat = std.fit_lat_m * normals[:, 1] + along * sine + across * cosine
    return lon, lat


def measured_speed(
    settings: SensorSettings,
    angle_rad: FloatArray,
    speed_mps: FloatArray,
    lat_speed_mps: FloatArray,
    normals: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return speeds along the boxes' axes got from the range rate, and their deviations.

    The range rate is the vehicle's speed along the line of sight less the ego's, which the sensor knows and adds. It
    takes the vehicle to move along its axis and divides by the cosine of the line of sight against that. The
    error of that angle is small beside the rest and left out.

    Args:
        angle_rad: Direction of the line of sight against the box's axis, shape (n,).
        speed_mps: True speed along that axis, shape (n,).
        lat_speed_mps: True speed across it, shape (n,).

    Returns:
        Speed and its standard deviation, each (n,); nan where it is not measured or the line of sight too oblique.
    """
    if settings.std_range_rate_mps is None:
        nothing = np.full(len(angle_rad), np.nan)
        return nothing, nothing
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    usable = np.abs(cosine) >= LEAST_COSINE
    divisor = np.where(usable, cosine, np.nan)
    along_line = speed_mps * cosine + lat_speed_mps * sine
    speed = (along_line + settings.std_range_rate_mps * normals) / divisor
    std = np.hypot(settings.std_range_rate_mps, TYPICAL_LAT_SPEED_MPS * sine) / np.abs(divisor)
    return speed, std
