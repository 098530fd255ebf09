"""Whether two folders hold the same experiment: which settings, code and model files differ."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from harness.config.layers import config_from_table, leaves, merged
from harness.config.model import RunConfig, TrackerConfig
from harness.storage.grid_folder import column_of
from harness.storage.manifest import CODE, INPUTS
from mmpf.numerics.arrays import BoolArray

WORLD = (
    *("traffic.mean_speed_mps", "traffic.flow_veh_per_h", "traffic.vehicles_in_range", "coverage.detected"),
    *("coverage.hidden_percent", "detection_noise.n", "detection_noise.lon_m", "mot.truth_n", "episode.candidates"),
)
"""Numbers that traffic and detections alone decide: where they differ, two runs did not see the same."""
VARIED = ("seed", "replay", "traffic.net", "traffic.density", "traffic.demand", "traffic.recording.ego")
"""Settings that runs of one grid differ in, by which they are paired."""
OF_DRIVES = ("driver", "heed_unseen", "provoke", "flow", "detected")
TRACKING = "tracker."
TRACKER = "tracker.name"


def settings_of_grid(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that hold for all runs of a ``grid.json``, by key, defaults filled in."""
    options = {"duration": table.get("duration_s"), "sensor": table.get("sensor"), "particles": table.get("particles")}
    nested = merged(None, options, [str(word) for word in table.get("settings") or ()])
    of_drives = {f"drive.{key}": table[key] for key in OF_DRIVES if table.get(key) is not None}
    return settings_of(nested) | of_drives


def settings_of(nested: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of a configuration by key, defaults filled in."""
    usual = RunConfig(tracker=TrackerConfig(name=str(nested.get("tracker", {}).get("name", "mmpf"))))
    return dict(leaves(usual.model_dump())) | dict(leaves(config_from_table(dict(nested)).model_dump()))


def differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return sentences on what differs between two experiments' settings: in world and scoring, and in trackers.

    Settings that only one of two different trackers has are left out.
    """
    two_trackers = a.get(TRACKER) != b.get(TRACKER)
    world: list[str] = []
    trackers: list[str] = []
    for key in dict.fromkeys((*a, *b)):
        if key in VARIED or key in (TRACKER, "tracker.model") or a.get(key) == b.get(key):
            continue
        if two_trackers and key.startswith(TRACKING) and None in (a.get(key), b.get(key)):
            continue
        told = f"{key} {_word(a.get(key))} in a, {_word(b.get(key))} in b"
        (trackers if key.startswith(TRACKING) else world).append(told)
    return world, trackers


def differing_code(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[str]:
    """Return sentences on code and input files that differ between two manifests; missing entries are ignored."""
    told: list[str] = []
    for table, name in ((CODE, "the code of"), (INPUTS, "the file")):
        first, second = (dict(side.get(table) or {}) for side in (a, b))
        told += [
            f"{name} {key} ({str(first[key])[:8]} in a, {str(second[key])[:8]} in b)"
            for key in sorted(first.keys() & second.keys())
            if first[key] != second[key]
        ]
    return told


def on_other_traffic(a: pd.DataFrame, b: pd.DataFrame) -> BoolArray:
    """Return which runs did not see the traffic and detections of their counterparts, shape (pairs,)."""
    differs = np.zeros(len(a), dtype=bool)
    for name in WORLD:
        first, second = column_of(a, name), column_of(b, name)
        # On another processor the last digits of a mean may fall otherwise.
        differs |= np.isfinite(first) & np.isfinite(second) & ~np.isclose(first, second, rtol=1e-9, atol=0.0)
    return differs


def _word(value: object) -> str:
    return "not set" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
