"""Re-acquisition: a component that appears where a hidden one may be is the hidden one, seen again."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
from scipy.optimize import linear_sum_assignment

from mmpf.cloud.mixture import Mixture
from mmpf.cloud.moments import Moments
from mmpf.cloud.sizes import sizes_of, with_measured_sizes
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray
from mmpf.joint_options import JointIdentity
from mmpf.state import LAT, LON, SPEED


def hand_over_identity(
    mixture: Mixture,
    moments: Moments,
    confirmed_now: BoolArray,
    options: JointIdentity,
    scan_s: float,
) -> tuple[Mixture, int]:
    """Give newly confirmed components the identities of the hidden components that they probably are.

    Each pair is judged by the density that the hidden component's particles give to the new one's place and speed,
    against the density of vehicles that were never seen before; all pairs together by optimal assignment.

    Args:
        mixture: The belief.
        moments: Its components' moments.
        confirmed_now: Components confirmed in this scan, shape (m,).
        options: Kernel widths and the density of unknown vehicles.
        scan_s: Time between scans.

    Returns:
        The belief without the hidden components that were seen again, and how many those are.
    """
    components = mixture.components
    hidden = np.flatnonzero(components.confirmed & ~confirmed_now & (components.unseen_s >= 2.0 * scan_s))
    new = np.flatnonzero(confirmed_now)
    if len(hidden) == 0 or len(new) == 0:
        return mixture, 0
    density = np.zeros((len(new), len(hidden)))
    _density_at(
        mixture.cloud.state,
        np.exp(mixture.cloud.log_weight),
        mixture.starts,
        hidden,
        moments.mean[:, new],
        np.array([options.kernel_lon_m, options.kernel_lat_m, options.kernel_speed_mps]),
        density,
    )
    density *= components.existence[hidden]
    was_unseen_by_then = (
        components.unseen_s[hidden][None, :] > (components.age_scans[new][:, None] * scan_s) - options.both_seen_s
    )
    log_ratio = np.log(np.maximum(np.where(was_unseen_by_then, density, 0.0), 1e-300) / options.unknown_density)
    rows, columns = linear_sum_assignment(np.maximum(log_ratio, 0.0), maximize=True)
    linked = log_ratio[rows, columns] > 0.0
    track_id = components.track_id.copy()
    track_id[new[rows[linked]]] = components.track_id[hidden[columns[linked]]]
    keep = np.ones(len(mixture), dtype=np.bool_)
    keep[hidden[columns[linked]]] = False
    components = with_measured_sizes(components, new[rows[linked]], sizes_of(components, hidden[columns[linked]]))
    renamed = replace(mixture, components=replace(components, track_id=track_id))
    return renamed.keep(keep), int(linked.sum())


@numba.njit(cache=True)
def _density_at(
    state: FloatArray,
    weight: FloatArray,
    starts: IntArray,
    hidden: IntArray,
    place: FloatArray,
    kernel: FloatArray,
    density: FloatArray,
) -> None:
    normaliser = 1.0 / ((2.0 * np.pi) ** 1.5 * kernel[0] * kernel[1] * kernel[2])
    for h in range(len(hidden)):
        for n in range(starts[hidden[h]], starts[hidden[h] + 1]):
            for c in range(place.shape[1]):
                lon = (state[LON, n] - place[LON, c]) / kernel[0]
                lat = (state[LAT, n] - place[LAT, c]) / kernel[1]
                speed = (state[SPEED, n] - place[SPEED, c]) / kernel[2]
                density[c, h] += normaliser * weight[n] * np.exp(-0.5 * (lon * lon + lat * lat + speed * speed))
