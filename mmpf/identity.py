"""Re-acquisition: a component that appears where a hidden one may be is the hidden one, seen again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mmpf.moments import component_moments
from mmpf.options import JointOptions
from mmpf.state import LAT, LON, Mixture

DETECTION_STD_M = 0.3
SCAN_S = 0.1
BIRTH_OVERLAP_S = 0.5


def hand_over_identity(
    mixture: Mixture, confirmed_now: npt.NDArray[np.bool_], options: JointOptions
) -> tuple[Mixture, int]:
    """Give each newly confirmed component the identity of the nearest hidden component that it may be.

    Args:
        mixture: The belief.
        confirmed_now: Components confirmed in this scan, shape (m,).
        options: How near is near enough.

    Returns:
        The belief without the hidden components that were seen again, and how many those are.
    """
    components = mixture.components
    moments = component_moments(mixture)
    age_s = components.age_scans * SCAN_S
    hidden = components.confirmed & ~confirmed_now & (components.unseen_s >= 2 * SCAN_S)
    lon, lat, std = moments.mean[LON], moments.mean[LAT], moments.std[LON]
    reach = options.stitch_std * np.hypot(std, DETECTION_STD_M) + options.stitch_margin_m
    distance = np.abs(lon[:, None] - lon[None, :]) / reach[None, :]
    possible = (
        confirmed_now[:, None]
        & hidden[None, :]
        & (distance < 1.0)
        & (np.abs(lat[:, None] - lat[None, :]) < options.stitch_lat_m)
        & (components.unseen_s[None, :] > age_s[:, None] - BIRTH_OVERLAP_S)
    )
    track_id = components.track_id.copy()
    keep = np.ones(len(mixture), dtype=np.bool_)
    new, old = np.nonzero(possible)
    taken: set[int] = set()
    for pair in np.argsort(distance[new, old], kind="stable"):
        if new[pair] in taken or not keep[old[pair]]:
            continue
        track_id[new[pair]] = components.track_id[old[pair]]
        keep[old[pair]] = False
        taken.add(int(new[pair]))
    renamed = replace(mixture, components=replace(components, track_id=track_id))
    return renamed.keep(keep), len(taken)
