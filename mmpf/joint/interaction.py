"""Two vehicles cannot overlap: the prior that keeps hidden particles away from visible vehicles."""

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel

# Half a footprint, a little wider across: cars do not drive mirror to mirror.
SCALE_ALONG, SCALE_ACROSS = 0.5, 0.63


def room_beside_seen_vehicles(
    mixture: Mixture,
    moments: Moments,
    is_seen: BoolArray,
    plane: SensorPlane,
    strength: float,
) -> FloatArray:
    """Return each particle's weight factor, below one where a hidden particle overlaps a seen vehicle, shape (n,).

    A Markov random field factor per pair of vehicles, taken as an importance weight (Khan, Balch and Dellaert 2004).

    Args:
        mixture: The belief.
        moments: Its components' moments.
        is_seen: Components that were seen lately; the others are hidden, shape (m,).
        plane: The plane around the sensor, whose own vehicle is always seen.
        strength: Exponent of full overlap; zero for no interaction.
    """
    factor = np.ones(len(mixture.cloud))
    holds_place = is_seen & mixture.components.confirmed
    ego, heading = plane.ego, np.append(moments.heading_rad[holds_place], plane.ego_turn_rad)
    if strength > 0.0:
        length, width = mixture.components.length_m[holds_place], mixture.components.width_m[holds_place]
        seen = (
            np.append(moments.mean[LON][holds_place], ego.lon_m),
            np.append(moments.mean[LAT][holds_place], ego.lat_m),
            np.cos(heading),
            np.sin(heading),
            SCALE_ALONG * np.append(length, ego.length_m),
            SCALE_ACROSS * np.append(width, ego.width_m),
        )
        place = mixture.cloud.state[LON], mixture.cloud.state[LAT]
        _discount_overlaps(*place, mixture.starts, ~is_seen, seen, strength, factor)
    return factor


@kernel()
def _discount_overlaps(
    lon: FloatArray,
    lat: FloatArray,
    starts: IntArray,
    is_excluded: BoolArray,
    seen: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
    strength: float,
    factor: FloatArray,
) -> None:
    seen_lon, seen_lat, cosine, sine, scale_lon, scale_lat = seen
    for m in range(len(starts) - 1):
        own_lon, own_lat = lon[starts[m] : starts[m + 1]], lat[starts[m] : starts[m + 1]]
        if not is_excluded[m] or len(own_lon) == 0:
            continue
        rear, front, right, left = own_lon[0], own_lon[0], own_lat[0], own_lat[0]
        for n in range(1, len(own_lon)):
            rear, front = min(rear, own_lon[n]), max(front, own_lon[n])
            right, left = min(right, own_lat[n]), max(left, own_lat[n])
        for s in range(len(seen_lon)):
            reach_lon = 2.0 * (scale_lon[s] * abs(cosine[s]) + scale_lat[s] * abs(sine[s]))
            reach_lat = 2.0 * (scale_lat[s] * abs(cosine[s]) + scale_lon[s] * abs(sine[s]))
            if not (rear - reach_lon <= seen_lon[s] <= front + reach_lon):
                continue
            if not (right - reach_lat <= seen_lat[s] <= left + reach_lat):
                continue
            for n in range(len(own_lon)):
                off_lon, off_lat = own_lon[n] - seen_lon[s], own_lat[n] - seen_lat[s]
                along = (off_lon * cosine[s] + off_lat * sine[s]) / scale_lon[s]
                across = (off_lat * cosine[s] - off_lon * sine[s]) / scale_lat[s]
                if abs(along) <= 2.0 and abs(across) <= 2.0:
                    overlap = np.exp(-0.5 * (along**4 + across**4))
                    factor[starts[m] + n] *= np.exp(-strength * overlap)
