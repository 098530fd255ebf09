"""Whether the vehicle ahead of the ego is in plain view and yet not reported by the tracker, scan by scan."""

from dataclasses import dataclass, field

import numpy as np

from harness.decisions.bodies import Bodies
from harness.scoring.evidence.directions import along_and_across
from harness.scoring.evidence.pairs import GATE_SIMILARITY, similarity
from harness.scoring.evidence.rules import PLAIN_VIEW_S, TIME_TOLERANCE_S
from harness.sensor.observation import Snapshot
from harness.storage.schema import VISIBLE


@dataclass
class PlainSight:
    """Who has been in plain view since when; the rule is that of ``harness.scoring.driving.withheld``."""

    _since_s: dict[str, float] = field(default_factory=dict)

    def note(self, snapshot: Snapshot) -> None:
        """Note who is in plain view; every snapshot in turn."""
        seen = snapshot.frame.vehicle_id[snapshot.observation.state == VISIBLE].tolist()
        self._since_s = {name: self._since_s.get(name, snapshot.frame.time_s) for name in seen}

    def withholds(self, snapshot: Snapshot, row: int, told: Bodies) -> bool:
        """Return whether the vehicle of a row is in plain view for long enough and no reported body is within the gate.

        The snapshot is the one that was noted last.
        """
        frame = snapshot.frame
        since_s = self._since_s.get(str(frame.vehicle_id[row]), np.inf)
        if frame.time_s - since_s < PLAIN_VIEW_S - TIME_TOLERANCE_S:
            return False
        direction = np.full(len(told), frame.axis_rad[row])
        away = along_and_across(frame.lon_m[row] - told.lon_m, frame.lat_m[row] - told.lat_m, direction)
        return not bool((similarity(*away) >= GATE_SIMILARITY).any())
