"""The search space of each tracker: a range or a few values for each setting.

Keys are dotted, as below ``tracker.options``. Settings of a group with a switch, ``doubtful.on``,
are searched only while it is on.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

from harness.config.layers import leaves, put
from harness.trackers.catalogue import tracker_options, tuned_options
from mmpf.options.base import fields_of

Value = object
Options = dict[str, Value]


class Range(NamedTuple):
    """Numbers between two ends, which both belong to it: by ratios if ``log``, only whole ones if ``whole``."""

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def end_near(self, value: float) -> str | None:
        """Return the end, ``low`` or ``high``, within 5 % of which a value lies."""
        low, high, at = (math.log(each) if self.log else each for each in (self.low, self.high, value))
        share = (at - low) / (high - low)
        return "low" if share <= 0.05 else "high" if share >= 0.95 else None


Choices = tuple[Value, ...]
Space = Mapping[str, Range | Choices]

_log_range, _integer_range = partial(Range, log=True), partial(Range, whole=True)

_MOTION: Space = {"lon_noise": _log_range(0.1, 10.0), "lat_noise": _log_range(0.01, 1.0)}
_NOISE: Space = {**_MOTION, "noise_factor": _log_range(0.5, 2.5)}
_MEMORY: Space = {"largest_std_lon_m": _log_range(2.0, 40.0), "longest_unseen_s": _log_range(0.5, 20.0)}
_GATE: Space = {"gate_std": Range(2.5, 6.0)}
_CONFIRM: Space = {"confirm_detections": _integer_range(1, 10), "birth_speed_std_mps": _log_range(2.0, 20.0)}
_BIRTH: Space = {**_CONFIRM, "held_unseen_s": _log_range(0.1, 1.5)}
_BELIEF: Space = {"detection_probability": Range(0.1, 0.95), "clutter_factor": _log_range(0.1, 10.0)}
_STITCHING: Space = {"stitching.margin_m": Range(0.0, 8.0), "stitching.gate_std": Range(1.5, 5.0)}
# The ego's path is no setting to search: a vehicle that stands there is always reported.
_DOUBTFUL: Space = {
    "doubtful.on": (False, True),
    "doubtful.standing_mps": _log_range(0.5, 8.0),
    "doubtful.standing_std": Range(0.0, 3.0),
    "doubtful.flow_mps": _log_range(1.0, 12.0),
    "doubtful.moved_s": Range(0.0, 3.0),
    "doubtful.trusted_after_s": _log_range(1.0, 20.0),
}
_STONE_SOUP: Space = {**_NOISE, **_MEMORY, **_GATE, **_BIRTH, **_DOUBTFUL}
_JPDA: Space = {**_BELIEF, **_STONE_SOUP}
_STITCHED: Space = {**_JPDA, **_STITCHING}
_BOXES: Space = {
    "longest_unseen_s": _log_range(0.2, 15.0),
    "least_overlap": Range(-0.8, 0.4),
    **_NOISE,
    **_BIRTH,
    **_DOUBTFUL,
}
# Particles stay as they are: they buy accuracy with time, which no search should trade off.
_MMPF: Space = {
    "joint.detectability.run_share": _log_range(0.03, 0.3),
    "reporting.reported_std_lon_m": _log_range(5.0, 40.0),
    "joint.association.birth_density": _log_range(0.01, 2.0),
    "joint.association.gate_std": Range(3.0, 7.0),
    "joint.kinds.confirm_above": _log_range(0.1, 0.9),
    "joint.kinds.withdraw_below": _log_range(0.03, 0.5),
    "joint.existence.confirm_s": Range(0.0, 0.9),
    "joint.removal.longest_unseen_s": _log_range(4.0, 20.0),
    "joint.identity.unknown_density": _log_range(1e-6, 1e-3),
    "model_error.accel": _log_range(0.2, 3.0),
    "model_error.lat_speed": _log_range(0.05, 0.6),
    "model_error.hidden_lon_factor": _log_range(0.7, 2.5),
}

SEARCH_SPACES: dict[str, Space] = {
    "mmpf": _MMPF,
    "stonesoup-gnn": _STONE_SOUP,
    "stonesoup-jpda": _JPDA,
    "stonesoup-jpda-stitched": _STITCHED,
    "immortal-kalman": {
        "association": ("distance", "mahalanobis"),
        "gate_lon_m": _log_range(2.0, 15.0),
        "gate_lat_m": _log_range(0.6, 3.0),
        **_NOISE,
        **_GATE,
        **_BIRTH,
        **_DOUBTFUL,
    },
    "box-kalman": {"association": ("overlap", "mahalanobis"), **_BOXES},
    # Its three parts make the method what it is: no search switches one off.
    "oc-sort": {
        "momentum_weight": _log_range(0.05, 2.0),
        "recovery_overlap": Range(-0.5, 0.8),
        "momentum_s": _log_range(0.1, 1.5),
        **_BOXES,
    },
    "pmbm": {
        "shadow_aware": (True, False),
        "newcomer_share": _log_range(0.001, 0.5),
        "reported_existence": Range(0.2, 0.9),
        "longest_unseen_s": _log_range(2.0, 20.0),
        "gate_std": Range(3.0, 7.0),
        **_BELIEF,
        **_NOISE,
        **_CONFIRM,
        **_DOUBTFUL,
    },
    "lmb": {
        "birth_existence": _log_range(0.001, 0.3),
        "reported_existence": Range(0.2, 0.9),
        "longest_unseen_s": _log_range(0.5, 20.0),
        "stay_s": _log_range(3.0, 300.0),
        **_BELIEF,
        **_NOISE,
        **_CONFIRM,
        **_DOUBTFUL,
    },
    "oracle-kalman": {**_MOTION, "longest_unseen_s": _log_range(2.0, 20.0), "confirm_detections": _integer_range(1, 8)},
}

DEFAULTS_IN_CODE = frozenset({"mmpf"})
"""Trackers whose tuned settings are their defaults themselves: ``tuned.toml`` only tells how they were found."""


def starts_of(tracker: str) -> list[Options]:
    """Return where a tracker's search begins: its defaults, and what was found before."""
    fields, space = dict(fields_of(tracker_options(tracker))), SEARCH_SPACES[tracker]
    defaults = {key: fields[key].get_default() for key in space}
    known = {key: value for key, value in defaults.items() if value is not None}
    found = {key: value for key, value in leaves(tuned_options(tracker)) if key in space}
    return [known, known | found] if found else [known]


def is_searched(key: str, options: Mapping[str, Value]) -> bool:
    """Return whether a setting makes a difference: its group has no switch, or the switch is on."""
    switch = f"{key.rpartition('.')[0]}.on"
    return key == switch or bool(options.get(switch, True))


def nested(options: Mapping[str, Value]) -> Options:
    """Return dotted options as the groups that a tracker takes."""
    table: Options = {}
    for key, value in options.items():
        put(table, key.split("."), value)
    return table
