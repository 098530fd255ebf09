"""Missed detections, vehicles that are hard to detect, and boxes that are shifted, split or merged."""

from dataclasses import dataclass, replace

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.memory import Chain, SensorMemory, VehicleMemory, next_state
from harness.sensor.noise import hidden_share
from harness.truth.frame import Frame
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken, turned

NARROW_M = 1.2
"""Width below which a vehicle is narrow."""
FRONT_SHARE = 0.35
"""Share of a long vehicle's length that its front box takes when it is split: a tractor before its trailer."""


def detection_probability(
    settings: SensorSettings, distance_m: FloatArray, visible_fraction: FloatArray, reachable: BoolArray
) -> FloatArray:
    """Return the probability of a detection, single misses and runs together, bursts apart; shape (n,).

    Args:
        settings: The sensor's figures.
        distance_m: Distance from the sensor, shape (n,).
        visible_fraction: How much of each vehicle is seen, shape (n,).
        reachable: Whether each is in range and no ego, shape (n,).
    """
    view = np.minimum(1.0, visible_fraction / settings.full_view_fraction) ** settings.view_exponent
    far = np.minimum(1.0, distance_m / settings.range_m)
    probability = settings.detection_probability * view * (1.0 - settings.missed_far_share * far**2)
    probability[~reachable | (visible_fraction < settings.hidden_fraction)] = 0.0
    return np.asarray(probability)


def detectabilities(settings: SensorSettings, memory: SensorMemory, frame: Frame) -> FloatArray:
    """Return the factor on each vehicle's detection probability, shape (n,), and remember those of new vehicles.

    A vehicle keeps its factor for the whole run. Factors come from a stream of their own, in the order in which the
    vehicles are met.
    """
    factor = np.ones(len(frame))
    if settings.detectability_share > 0.0:
        new = [name for name in frame.vehicle_id.tolist() if name not in memory.detectability]
        drawn = drawn_factors(settings, len(new), memory.streams.detectability)
        memory.detectability.update(zip(new, drawn.tolist(), strict=True))
        factor = np.array([memory.detectability[name] for name in frame.vehicle_id.tolist()])
    narrow = frame.width_m < NARROW_M
    return np.where(narrow, settings.detectability_narrow * factor, factor)


def drawn_factors(settings: SensorSettings, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw the factors of vehicles: one of most, of the others ``least + (1 - least) * Beta``, shape (count,)."""
    least = settings.detectability_least
    mean, std = (settings.detectability_mean - least) / (1.0 - least), settings.detectability_spread / (1.0 - least)
    both = mean * (1.0 - mean) / std**2 - 1.0
    hard = rng.random(count) < settings.detectability_share
    return np.where(hard, least + (1.0 - least) * rng.beta(mean * both, (1.0 - mean) * both, size=count), 1.0)


def miss_chain(settings: SensorSettings, probability: FloatArray, visible_fraction: FloatArray) -> Chain:
    """Return the runs of misses, each part of shape (n,); who has no chance of a detection is in none."""
    share = np.where(probability > 0.0, settings.missed_in_runs * (1.0 - probability), 0.0)
    hidden = hidden_share(settings, visible_fraction)
    run_s = settings.missed_run_s + (settings.missed_run_hidden_s - settings.missed_run_s) * hidden
    return Chain(share, run_s)


def advance(
    settings: SensorSettings, memory: VehicleMemory, misses: Chain, step_s: float, rng: np.random.Generator
) -> VehicleMemory:
    """Return what is remembered of the vehicles a step later, its drift left as it was."""
    uniforms = rng.random((len(memory.vehicle_id), 4))
    bursts = Chain(settings.burst_share, settings.burst_s)
    splits, merges = Chain(settings.split_share, settings.split_s), Chain(settings.merged_share, settings.merged_s)

    def after(chain: Chain, before: FloatArray, column: int) -> FloatArray:
        return next_state(chain, before, step_s, uniforms[:, column]).astype(np.float64)

    return replace(
        memory,
        missed=after(misses, memory.missed, 0),
        burst=after(bursts, memory.burst, 1),
        split=after(splits, memory.split, 2),
        merged=after(merges, memory.merged, 3),
    )


@dataclass(frozen=True)
class DetectedBoxes:
    """What the detector takes for a vehicle each, struct of arrays, each of shape (b,).

    Attributes:
        origin: Index of the vehicle in the frame.
        lon_m: Longitudinal position of the box's true middle.
        axis_rad: Direction of its long side against the frame's longitudinal axis.
        second: Whether it is the other part of a vehicle that another box stands for.
    """

    origin: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    axis_rad: FloatArray
    second: BoolArray


def merged(
    settings: SensorSettings, boxes: DetectedBoxes, merges: BoolArray, visible_fraction: FloatArray
) -> DetectedBoxes:
    """Return the boxes with those that merge gone, each into the nearest one that it nearly touches.

    The box that stays, that of the vehicle of which more is seen, stands for it and reaches over both.

    Args:
        settings: The sensor's figures.
        boxes: One for each vehicle that is detected, b of them.
        merges: Whether each would merge now, shape (b,).
        visible_fraction: How much of each is seen, shape (b,).
    """
    lon, lat, length, width = (np.array(part) for part in (boxes.lon_m, boxes.lat_m, boxes.length_m, boxes.width_m))
    axis = boxes.axis_rad
    there = np.ones(len(lon), dtype=np.bool_)
    whole = np.ones(len(lon), dtype=np.bool_)
    for k in np.flatnonzero(merges):
        along, across = turned(lon, lat, axis[k])
        reach_along, reach_across = _reaches(length, width, axis - axis[k])
        gap = np.hypot(
            np.maximum(np.abs(along - along[k]) - (reach_along + 0.5 * length[k]), 0.0),
            np.maximum(np.abs(across - across[k]) - (reach_across + 0.5 * width[k]), 0.0),
        )
        gap[~(there & whole)] = np.inf
        gap[k] = np.inf
        other = int(gap.argmin())
        if not (whole[k] and gap[other] <= settings.merged_gap_m):
            continue
        stays, goes = (k, other) if visible_fraction[k] > visible_fraction[other] else (other, k)
        middles, reaches = turned(lon, lat, axis[stays]), _reaches(length, width, axis - axis[stays])
        for middle, reach, size in zip(middles, reaches, (length, width), strict=True):
            low = min(middle[j] - reach[j] for j in (stays, goes))
            high = max(middle[j] + reach[j] for j in (stays, goes))
            middle[stays], size[stays] = 0.5 * (low + high), high - low
        lon[stays], lat[stays] = turned(middles[0][stays], middles[1][stays], -axis[stays])
        there[goes] = whole[goes] = whole[stays] = False
    return taken(replace(boxes, lon_m=lon, lat_m=lat, length_m=length, width_m=width), there)


def _reaches(length: FloatArray, width: FloatArray, turn_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far bodies turned against a frame reach from their middles along and across it, each (b,)."""
    cosine, sine = np.abs(np.cos(turn_rad)), np.abs(np.sin(turn_rad))
    half_length, half_width = 0.5 * length, 0.5 * width
    return half_length * cosine + half_width * sine, half_length * sine + half_width * cosine


def split(settings: SensorSettings, boxes: DetectedBoxes, splits: BoolArray, heading_rad: FloatArray) -> DetectedBoxes:
    """Return the boxes with those of long vehicles that split in two: the longer part, then the front at the end.

    Args:
        settings: The sensor's figures.
        boxes: The boxes, b of them.
        splits: Whether each would split now, shape (b,).
        heading_rad: Heading of each against the road, shape (b,).
    """
    chosen = np.flatnonzero(splits & (boxes.length_m >= settings.split_length_m))
    length = boxes.length_m[chosen]
    cosine, sine = np.cos(heading_rad[chosen]), np.sin(heading_rad[chosen])

    def part(from_middle: FloatArray, share: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        return (
            boxes.lon_m[chosen] + from_middle * cosine,
            boxes.lat_m[chosen] + from_middle * sine,
            length * share,
        )

    lon, lat, long = (np.array(column) for column in (boxes.lon_m, boxes.lat_m, boxes.length_m))
    lon[chosen], lat[chosen], long[chosen] = part(-0.5 * FRONT_SHARE * length, 1.0 - FRONT_SHARE)
    front_lon, front_lat, front_long = part(0.5 * (1.0 - FRONT_SHARE) * length, FRONT_SHARE)
    first = replace(boxes, lon_m=lon, lat_m=lat, length_m=long, second=np.zeros(len(lon), dtype=np.bool_))
    second = np.ones(len(chosen), dtype=np.bool_)
    front = replace(taken(boxes, chosen), lon_m=front_lon, lat_m=front_lat, length_m=front_long, second=second)
    return joined(first, front)


def shifted(
    settings: SensorSettings,
    boxes: DetectedBoxes,
    visible_fraction: FloatArray,
    angle_rad: FloatArray,
    side: FloatArray,
) -> DetectedBoxes:
    """Return the boxes moved towards what is seen of them: away from who hides them, and towards the near end.

    Of a vehicle whose hidden part is a share h of its extent, the middle of what is left is off by h / 2 of it.

    Args:
        visible_fraction: How much of each is seen, shape (b,).
        angle_rad: Direction of the line of sight against each box's axis, shape (b,).
        side: 1 where its left side, seen from the sensor, is what is seen, -1 for the right, 0 if neither; shape (b,).
    """
    recedes = 0.5 * settings.centre_shift_share * (1.0 - visible_fraction)
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    along = np.clip(-side * sine - cosine, -1.0, 1.0) * recedes * boxes.length_m
    across = side * cosine * recedes * boxes.width_m
    off_lon, off_lat = turned(along, across, -boxes.axis_rad)
    return replace(boxes, lon_m=boxes.lon_m + off_lon, lat_m=boxes.lat_m + off_lat)
