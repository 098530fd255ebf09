"""Controls vehicles in SUMO: the ego follows its driver, a provoked vehicle brakes, and contacts are detected."""

import numpy as np

from harness.closedloop.episode_start import EpisodeStart
from harness.closedloop.plan import BRAKE, DARK
from harness.scoring.metrics.closedloop import Contact
from harness.truth.frame import Frame
from harness.truth.sumo.brokendown import stand
from harness.truth.sumo.session import Sumo
from mmpf.numerics.arrays import BoolArray, turned

NO_CHECKS, ALL_CHECKS = 0, 31
"""SUMO's speed modes: drive what is demanded, whatever comes of it; and its default."""
PROVOKED_BRAKING_MPS2, STANDS_S = -5.0, 1.0
NO_SPEED = -1.0
"""By this speed SUMO's own driver takes a vehicle back."""
KEEPS_LANE_M, BETWEEN_WITHIN_M = 1.8, 250.0


class Steering:
    """Controls the ego of an episode and the vehicle that is provoked."""

    def __init__(self, sumo: Sumo, at: EpisodeStart) -> None:
        """Take hold of a simulation as it stands at the start of the episode."""
        self._sumo, self._at = sumo, at
        self._stands_s = 0.0

    def take_over(self) -> None:
        """Let SUMO neither check the ego's speed nor change its lane from now on."""
        self._sumo.vehicle.setSpeedMode(self._at.ego, NO_CHECKS)
        self._sumo.vehicle.setLaneChangeMode(self._at.ego, NO_CHECKS)
        if self._at.kind in (BRAKE, DARK):
            self._sumo.vehicle.setSpeedMode(self._at.provoked, NO_CHECKS)
        if self._at.kind == DARK:
            self._sumo.vehicle.setLaneChangeMode(self._at.provoked, NO_CHECKS)
        if self._at.stands is not None:
            stand(self._sumo, self._at.provoked, self._at.stands)
            self._keep_between_clear()

    def act(self, demand_mps2: float, speed_mps: float, step_s: float) -> None:
        """Set what the ego and the provoked vehicle do in the next step, of which no car drives backwards."""
        self._sumo.vehicle.setSpeed(self._at.ego, max(0.0, speed_mps + demand_mps2 * step_s))
        if self._at.kind in (BRAKE, DARK) and self._at.provoked in self._sumo.vehicle.getIDList():
            self._brake(step_s)

    def _keep_between_clear(self) -> None:
        """Keep other vehicles from changing lanes between the ego and the vehicle that stands ahead."""
        now = self._at.frames[-1]
        beside = np.abs(now.lat_m - now.lat_m[now.ego]) > KEEPS_LANE_M
        near = np.abs(now.lon_m - now.lon_m[now.ego]) < BETWEEN_WITHIN_M
        for name in now.vehicle_id[beside & near].tolist():
            self._sumo.vehicle.setLaneChangeMode(name, NO_CHECKS)

    def _brake(self, step_s: float) -> None:
        """Brake the provoked vehicle until it stands, and release it after a while."""
        vehicle, name = self._sumo.vehicle, self._at.provoked
        if self._stands_s > STANDS_S:
            return
        speed_mps = vehicle.getSpeed(name)
        vehicle.setSpeed(name, max(0.0, speed_mps + PROVOKED_BRAKING_MPS2 * step_s))
        if speed_mps > 0.0:
            return
        self._stands_s += step_s
        if self._stands_s > STANDS_S:
            vehicle.setSpeed(name, NO_SPEED)
            vehicle.setSpeedMode(name, ALL_CHECKS)

    def contact(self, frame: Frame, time_s: float) -> Contact | None:
        """Return the ego's collision if its body overlaps another, or if SUMO reports one; None if there is none.

        ``time_s`` is the time since the start of the episode.
        """
        reported = {
            name
            for collision in self._sumo.simulation.getCollisions()
            for name in (collision.collider, collision.victim)
            if self._at.ego in (collision.collider, collision.victim) and name != self._at.ego
        }
        touched = overlaps(frame) | np.isin(frame.vehicle_id, list(reported))
        if not touched.any():
            return None
        ego = frame.ego
        lon_m, lat_m = frame.lon_m - frame.lon_m[ego], frame.lat_m - frame.lat_m[ego]
        ways = np.stack([np.cos(frame.axis_rad), np.sin(frame.axis_rad)])
        ahead_m = lon_m * ways[0, ego] + lat_m * ways[1, ego]
        impact_mps = np.hypot(*(ways * frame.speed_mps - (ways * frame.speed_mps)[:, [ego]]))
        other = int(np.abs(np.where(touched, ahead_m, np.inf)).argmin())
        return Contact(
            vehicle_id=str(frame.vehicle_id[other]),
            time_s=time_s,
            impact_mps=float(impact_mps[other]),
            into=bool(ahead_m[other] > 0.0),
        )


def overlaps(frame: Frame) -> BoolArray:
    """Return whose body overlaps the ego's, (n,); never its own. Bodies lie along a main road, or as they head."""
    ego, axis_rad = frame.ego, frame.axis_rad
    lon_m, lat_m = frame.lon_m - frame.lon_m[ego], frame.lat_m - frame.lat_m[ego]
    touched = np.ones(len(frame), dtype=np.bool_)
    for side_rad in (axis_rad, np.full(len(frame), axis_rad[ego])):
        reach_m = np.zeros((2, len(frame)))
        for heading_rad, length_m, width_m in (
            (axis_rad, frame.length_m, frame.width_m),
            (axis_rad[ego], frame.length_m[ego], frame.width_m[ego]),
        ):
            along, across = np.abs(np.cos(side_rad - heading_rad)), np.abs(np.sin(side_rad - heading_rad))
            reach_m += 0.5 * np.stack([length_m * along + width_m * across, length_m * across + width_m * along])
        off_m = np.abs(np.stack(turned(lon_m, lat_m, side_rad)))
        touched &= (off_m < reach_m).all(axis=0)
    touched[ego] = False
    return touched
