"""What the search for each tracker's settings may change: one ladder of values for each setting, in the order tried.

Keys are dotted, as below ``tracker.options``. A ladder goes from one end to the other, since the search moves along it
step by step, forwards first; a default that is not on its ladder is put there in order. The search begins at the
trackers' own defaults, so that it leans on no earlier one. A space has about a dozen settings at most, so that a search
of the usual budget tries each of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from harness.trackers.catalogue import tracker_options
from mmpf.settings import fields_of

Value = object
Options = dict[str, Value]
Space = Mapping[str, tuple[Value, ...]]

_MOTION: Space = {"lon_noise": (0.1, 0.3, 1.0, 3.0), "lat_noise": (0.01, 0.03, 0.1, 0.3)}
_NOISE: Space = {**_MOTION, "noise_factor": (1.0, 1.5, 2.0)}
_MEMORY: Space = {"largest_std_lon_m": (5.0, 10.0, 20.0, 40.0), "longest_unseen_s": (2.0, 5.0, 10.0, 15.0)}
_GATE: Space = {"gate_std": (3.0, 3.9, 5.0)}
_BIRTH: Space = {
    "confirm_detections": (2, 3, 5, 8, 12),
    "held_unseen_s": (0.15, 0.35, 0.7, 1.2),
    "birth_speed_std_mps": (10.0, 5.0, 3.0),
}
_BELIEF: Space = {"detection_probability": (None, 0.7, 0.5, 0.3), "clutter_factor": (0.1, 0.3, 1.0, 3.0, 10.0)}
_STITCHING: Space = {"stitching.margin_m": (1.0, 3.0, 5.0), "stitching.gate_std": (2.0, 3.0, 4.0)}
_STONE_SOUP: Space = {**_NOISE, **_MEMORY, **_GATE, **_BIRTH}
_JPDA: Space = {**_BELIEF, **_STONE_SOUP}
# Particles stay as they are: they buy accuracy with time, which no search should trade off.
_MMPF: Space = {
    "joint.detectability.run_share": (0.05, 0.08, 0.12, 0.2),
    "joint.ghosts.vehicle_in_view": (0.02, 0.05, 0.1, 0.15),
    "joint.ghosts.confirm_log_odds": (0.0, 0.5, 1.0, 2.0),
    "reporting.reported_std_lon_m": (6.0, 10.0, 15.0, 20.0),
    "joint.association.birth_density": (0.03, 0.1, 0.3, 1.0),
    "joint.existence.confirm_hits": (2, 3, 5, 8, 12),
    "joint.removal.longest_unseen_s": (5.0, 10.0, 15.0),
    "model_error.accel": (0.3, 0.6, 1.0),
    "model_error.lat_speed": (0.1, 0.2, 0.4),
    "model_error.hidden_lon_factor": (1.0, 1.3, 1.7, 2.2),
    "joint.association.gate_std": (3.5, 4.5, 6.0),
    "joint.identity.unknown_density": (3e-6, 3e-5, 3e-4),
}
_IMMORTAL: Space = {
    "association": ("distance", "mahalanobis"),
    **_NOISE,
    "gate_lon_m": (3.0, 4.5, 6.0, 9.0),
    "gate_lat_m": (1.2, 1.6, 2.2),
    **_GATE,
    **_BIRTH,
}
_REMEMBERED: Space = {"longest_unseen_s": (1.0, 3.0, 5.0, 10.0)}
_BOXES: Space = {
    "longest_unseen_s": (0.2, 1.0, 3.0, 5.0, 10.0),
    "least_overlap": (-0.7, -0.4, -0.2, 0.0),
    "association": ("overlap", "mahalanobis"),
    **_NOISE,
    **_BIRTH,
}
# Its three parts make the method what it is: no search switches one off.
_OC_SORT: Space = {
    "longest_unseen_s": (0.2, 1.0, 3.0, 5.0, 10.0),
    "least_overlap": (-0.7, -0.4, -0.2, 0.0),
    "momentum_weight": (0.1, 0.2, 0.5, 1.0),
    "recovery_overlap": (0.0, 0.3, 0.6),
    "momentum_s": (0.3, 0.6, 1.2),
    **_NOISE,
    **_BIRTH,
}
_IMM: Space = {
    **_REMEMBERED,
    **_BELIEF,
    **_NOISE,
    "accel_std_mps2": (0.75, 1.5, 3.0),
    "turn_std_rad_per_s": (0.05, 0.1, 0.2),
    "gate_std": (3.9, 5.0, 6.0),
    **_BIRTH,
}
_PMBM: Space = {
    "shadow_aware": (True, False),
    "newcomer_share": (0.03, 0.1, 0.3),
    **_BELIEF,
    **_NOISE,
    "reported_existence": (0.3, 0.5, 0.8),
    "longest_unseen_s": (5.0, 10.0, 15.0),
    "gate_std": (3.9, 4.5, 6.0),
    "confirm_detections": (2, 3, 5, 8),
    "birth_speed_std_mps": (10.0, 5.0, 3.0),
}

SEARCH_SPACES: dict[str, Space] = {
    "mmpf": _MMPF,
    "stonesoup-gnn": _STONE_SOUP,
    "stonesoup-jpda": _JPDA,
    "stonesoup-jpda-stitched": {**_JPDA, **_STITCHING},
    "stonesoup-jpda-aware": {
        "longest_missed": (5.0, 10.0, 20.0, 40.0),
        **_BELIEF,
        **_NOISE,
        **_MEMORY,
        **_GATE,
        **_STITCHING,
        **_BIRTH,
    },
    "immortal-kalman": _IMMORTAL,
    "stonesoup-particle": _STONE_SOUP,
    "box-kalman": _BOXES,
    "oc-sort": _OC_SORT,
    "imm-gnn": _IMM,
    "pmbm": _PMBM,
    "oracle-kalman": {**_MOTION, "longest_unseen_s": (5.0, 10.0, 15.0), "confirm_detections": (2, 3, 5)},
}

ALWAYS: dict[str, Options] = {name: {"coarse_gate": True} for name in SEARCH_SPACES if name.startswith("stonesoup")}
"""Options that save the search time and change no tracks, or only their random draws."""

DEFAULTS_IN_CODE = frozenset({"mmpf"})
"""Trackers whose tuned settings are their defaults themselves: ``tuned.toml`` only tells how they were found."""


def default_options(tracker: str) -> Options:
    """Return where a tracker's search begins: the defaults of the settings in its space, by dotted key."""
    fields = dict(fields_of(tracker_options(tracker)))
    return {key: fields[key].get_default() for key in SEARCH_SPACES[tracker]}


def ladders(tracker: str) -> dict[str, list[Value]]:
    """Return the values of each setting of a tracker in order, with the default among them."""
    defaults = default_options(tracker)
    return {key: _with(defaults[key], values) for key, values in SEARCH_SPACES[tracker].items()}


def nested(options: Mapping[str, Value]) -> Options:
    """Return dotted options as the groups that a tracker takes."""
    table: Options = {}
    for key, value in options.items():
        group = table
        *names, last = key.split(".")
        for name in names:
            inner = group.setdefault(name, {})
            if not isinstance(inner, dict):
                raise TypeError(f"{key}: {name} is a setting and a group")
            group = inner
        group[last] = value
    return table


def _with(default: Value, values: Sequence[Value]) -> list[Value]:
    if default in values:
        return list(values)
    return sorted([*values, default], key=lambda value: value if isinstance(value, int | float) else math.inf)
