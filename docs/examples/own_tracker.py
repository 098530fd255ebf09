"""
A tracker of your own
=====================

A tracker is any object with ``step(scan) -> Tracks``. This one takes the nearest detection and corrects its estimate
by a fixed share: about the least that can be called a tracker. It runs on the same traffic and the very same
detections as the particle filter, so that the difference between the two is the trackers' alone.
"""

# %%
# The harness calls a factory once for each episode, with what a tracker may know beforehand (the lanes, the sensor's
# data sheet, the tracker's own random generator) and with its options. Here the class itself is the factory.

import tempfile
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import harness
from mmpf import Tracks

TENTATIVE, CONFIRMED = 0, 1  # the states of a track; tentative ones are not scored


@dataclass
class Followed:
    """One vehicle as the tracker knows it."""

    number: int
    lon_m: float
    lat_m: float
    speed_mps: float
    seen_s: float
    hits: int = 1


class NearestNeighbour:
    """Follows each vehicle by the nearest detection within 3 m."""

    def __init__(self, setting, options=None):
        self.gain = (options or {}).get("gain", 0.5)
        self.step_s = setting.step_s
        self.followed = []
        self.next_number = 1

    def step(self, scan):
        left = list(zip(scan.detections.lon_m, scan.detections.lat_m, strict=True))
        for vehicle in self.followed:
            vehicle.lon_m += vehicle.speed_mps * self.step_s
            away = [np.hypot(lon - vehicle.lon_m, lat - vehicle.lat_m) for lon, lat in left]
            if away and min(away) < 3.0:
                lon, lat = left.pop(int(np.argmin(away)))
                vehicle.speed_mps += 0.3 * self.gain * (lon - vehicle.lon_m) / self.step_s
                vehicle.lon_m += self.gain * (lon - vehicle.lon_m)
                vehicle.lat_m += self.gain * (lat - vehicle.lat_m)
                vehicle.hits, vehicle.seen_s = vehicle.hits + 1, scan.time_s
        self.followed = [vehicle for vehicle in self.followed if scan.time_s - vehicle.seen_s < 1.5]
        for lon, lat in left:
            self.followed.append(Followed(self.next_number, lon, lat, scan.ego.speed_mps, scan.time_s))
            self.next_number += 1
        return self.tracks()

    def tracks(self):
        def column(name):
            return np.array([getattr(vehicle, name) for vehicle in self.followed], dtype=float)

        one = np.ones(len(self.followed))
        return Tracks(
            track_id=column("number").astype(np.int64),
            lon_m=column("lon_m"),
            lat_m=column("lat_m"),
            speed_mps=column("speed_mps"),
            lat_speed_mps=0.0 * one,
            accel_mps2=0.0 * one,
            std_lon_m=0.3 * one,
            std_lat_m=0.2 * one,
            std_speed_mps=one,
            existence=one,
            state=np.where(column("hits") >= 3, CONFIRMED, TENTATIVE).astype(np.int8),
        )


# %%
# Traffic and detections follow from the seed and not from the tracker, so two runs with equal settings are a fair
# comparison. On the command line the same tracker is ``--tracker module:NearestNeighbour``.

folder = Path(tempfile.mkdtemp())
same = {"net": "us101", "density": 30, "seed": 1, "duration": 5.0}
runs = {
    "nearest neighbour": harness.run(tracker=NearestNeighbour, out=folder / "nearest", **same),
    "mmpf": harness.run(tracker="mmpf", out=folder / "mmpf", **same),
}
names = ["mot.hota", "mot.id_switches", "mot.missed"]
pd.DataFrame({name: run.metrics.loc[names, "value"] for name, run in runs.items()})

# %%
# Left, the error of each tracker, by how much of the vehicle the sensor saw; right, how often it had no track. Read
# both: a vehicle without a track has no error, so a tracker that ends tracks early looks accurate. The
# nearest-neighbour tracker predicts at the last speed, and ends a track after 1.5 s without a detection.

states = ["visible", "partial", "hidden"]
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
for place, (name, run) in enumerate(runs.items()):
    errors = run.errors
    size = np.hypot(errors["lon_error_m"], errors["lat_error_m"]).groupby(errors["state"]).mean()
    without = 100.0 * errors["lon_error_m"].isna().groupby(errors["state"]).mean()
    where = np.arange(len(states)) + 0.4 * place - 0.2
    left.bar(where, size.reindex(states), width=0.38, label=name)
    right.bar(where, without.reindex(states), width=0.38, label=name)
for axes in (left, right):
    axes.set_xticks(range(len(states)), ["visible", "partly hidden", "hidden"])
    axes.set_xlabel("how much of the vehicle the sensor saw")
left.set_ylabel("mean position error (m)")
right.set_ylabel("vehicles without a track (%)")
left.legend(frameon=False)
plt.show()

# %%
# :doc:`/how-to/tracker` lists the requirements on a tracker, and checks for them.
