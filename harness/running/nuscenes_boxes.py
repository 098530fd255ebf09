"""The boxes of nuScenes' JSON as its own rules score them, of all its tracking classes."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.common.isolation import ProcessLimits, isolated
from harness.common.untrusted_files import read_json
from harness.scoring.metrics.by_recall import scores_by_class

RANGE_M = {"car": 50.0, "truck": 50.0, "bus": 50.0, "trailer": 50.0}
RANGE_M |= {"pedestrian": 40.0, "bicycle": 40.0, "motorcycle": 40.0}
"""The classes of the tracking task, and how far from the ego boxes of each count."""
COLUMNS = ["token", "id", "category", "x_m", "y_m", "score"]


def nuscenes_scores(truth: Path, tracks: Path, poses: pd.DataFrame | None, step_s: float) -> dict[str, Any] | None:
    """Return AMOTA and AMOTP of nuScenes' rules: their means over the classes, and of each; None without any.

    Args:
        truth: Truth in the layout of tracking results; boxes with ``num_pts`` 0 do not count.
        tracks: Tracking results.
        poses: The ego's, with ``sample_token``, ``episode``, ``time_s``, ``lon_m`` and ``lat_m``: boxes beyond their
            class's range are left out. None leaves none out, and takes the samples for one scene in their order.
        step_s: Time between samples without poses.
    """
    (tokens, real), (_, found) = (
        isolated(partial(_boxes, path), f"`{role}`: {path} (nuscenes)", ProcessLimits.for_files([path]))
        for role, path in (("truth", truth), ("tracks", tracks))
    )
    if found["score"].isna().any():
        return None
    times = pd.DataFrame({"token": tokens, "scene": 0, "time_s": np.arange(len(tokens)) * step_s})
    if poses is not None and {"sample_token", "episode", "time_s"} <= set(poses):
        places = {"sample_token": "token", "episode": "scene", "lon_m": "ego_x_m", "lat_m": "ego_y_m"}
        times = poses.rename(columns=places)[[*places.values(), "time_s"]]
        times = times[times["token"].isin(tokens)].drop_duplicates("token")
    real, found = (_within_range(boxes.merge(times, on="token")) for boxes in (real, found))
    if not (scores := scores_by_class(real, found, times)):
        return None
    by_class = {name: {"amota": each.amota, "amotp": each.amotp} for name, each in scores.items()}
    means = pd.DataFrame(by_class.values()).mean()
    return {"amota": float(means["amota"]), "amotp": float(means["amotp"]), "by_class": by_class}


def _boxes(path: Path) -> tuple[list[str], pd.DataFrame]:
    results = read_json(path, "tracks")["results"]
    rows = [
        (
            token,
            str(box["tracking_id"]),
            box["tracking_name"],
            *map(float, box["translation"][:2]),
            float(box.get("tracking_score", np.nan)),
        )
        for token, found in results.items()
        for box in found
        if box["tracking_name"] in RANGE_M and box.get("num_pts", -1) != 0
    ]
    return list(results), pd.DataFrame(rows, columns=COLUMNS)


def _within_range(boxes: pd.DataFrame) -> pd.DataFrame:
    if "ego_x_m" not in boxes:
        return boxes
    away = np.hypot(boxes["x_m"] - boxes["ego_x_m"], boxes["y_m"] - boxes["ego_y_m"])
    return boxes[away < boxes["category"].map(RANGE_M)]
