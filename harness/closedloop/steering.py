"""Hands on SUMO's wheel: the ego drives by its driver's demand, a provoked vehicle brakes, and contacts are noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.closedloop.beliefs import ego_of, true_bodies
from harness.closedloop.handover import HandOver
from harness.closedloop.plan import BRAKE, GAP
from harness.closedloop.traffic import row_of
from harness.decisions.belief import believe
from harness.decisions.drivers.following import SAFE_DECEL_MPS2, following
from harness.scoring.closedloop import Contact
from harness.truth.frame import Frame
from harness.truth.sumo.session import Sumo
from mmpf.road import Road

NO_CHECKS, ALL_CHECKS = 0, 31
"""SUMO's speed modes: drive what is demanded, whatever comes of it; and its default."""
PROVOKED_BRAKING_MPS2, STANDS_S = -5.0, 1.0
NO_SPEED = -1.0
"""By this speed SUMO's own driver takes a vehicle back."""
ON_COURSE_M = 0.05
"""So near to where it steers for the ego is there."""


class Steering:
    """Drives the ego of an episode, and whom it provokes."""

    def __init__(self, sumo: Sumo, at: HandOver) -> None:
        """Take hold of a simulation as it stands at the hand-over."""
        self._sumo, self._at = sumo, at
        self._stands_s = 0.0

    def take_over(self) -> None:
        """Let SUMO neither check the ego's speed nor change its lane from now on."""
        self._sumo.vehicle.setSpeedMode(self._at.ego, NO_CHECKS)
        self._sumo.vehicle.setLaneChangeMode(self._at.ego, NO_CHECKS)
        if self._at.kind in (BRAKE, GAP):
            self._sumo.vehicle.setSpeedMode(self._at.provoked, NO_CHECKS)
        if self._at.kind == GAP:
            self._sumo.vehicle.setLaneChangeMode(self._at.provoked, NO_CHECKS)

    def act(self, demand_mps2: float, speed_mps: float, step_s: float) -> None:
        """Set what the ego and the provoked vehicle do in the next step, of which no car drives backwards."""
        self._sumo.vehicle.setSpeed(self._at.ego, max(0.0, speed_mps + demand_mps2 * step_s))
        if self._at.kind == BRAKE and self._at.provoked in self._sumo.vehicle.getIDList():
            self._brake(step_s)

    def steer(self, aim_m: float, lat_m: float) -> None:
        """Let the ego move sideways towards a lateral position, whoever is there."""
        if abs(aim_m - lat_m) > ON_COURSE_M:
            self._sumo.vehicle.changeSublane(self._at.ego, aim_m - lat_m)

    def insist(self, frame: Frame, road: Road, step_s: float) -> None:
        """Let the provoked vehicle of an episode ``gap`` go on as fast as it did, minding who is in its lane.

        It drives by the truth, but makes room for nobody who is not in its lane yet, and brakes no harder for who is
        than a safe gap asks of it.
        """
        name = self._at.provoked
        if name not in frame.vehicle_id:
            return
        its = replace(frame, ego=row_of(frame, name))
        belief = believe(true_bodies(its), ego_of(its), road)
        accel_mps2 = max(float(following(belief, belief.leader)[0]), -SAFE_DECEL_MPS2)
        began = self._at.frames[-1]
        fastest_mps = float(began.speed_mps[row_of(began, name)])
        speed_mps = float(its.speed_mps[its.ego]) + accel_mps2 * step_s
        self._sumo.vehicle.setSpeed(name, min(max(0.0, speed_mps), fastest_mps))

    def _brake(self, step_s: float) -> None:
        """Brake the provoked vehicle until it stands, and let it go on after a while."""
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

        Args:
            frame: The present frame, with the ego.
            time_s: Time since the hand-over.
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
        away_m = np.where(touched, frame.lon_m - frame.lon_m[ego], np.inf)
        other = int(np.abs(away_m).argmin())
        return Contact(
            vehicle_id=str(frame.vehicle_id[other]),
            time_s=time_s,
            impact_mps=float(abs(frame.speed_mps[ego] - frame.speed_mps[other])),
            into=bool(away_m[other] > 0.0),
        )


def overlaps(frame: Frame) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return whose body overlaps the ego's, both taken to lie along the road, shape (n,); never the ego's own."""
    ego = frame.ego
    along = np.abs(frame.lon_m - frame.lon_m[ego]) < 0.5 * (frame.length_m + frame.length_m[ego])
    across = np.abs(frame.lat_m - frame.lat_m[ego]) < 0.5 * (frame.width_m + frame.width_m[ego])
    touched = np.asarray(along & across)
    touched[ego] = False
    return touched
