"""Small synthetic runs for the scoring tests."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness.scoring.driving.asked import DriverSetup
from harness.scoring.score import RunScorer

STEP_S = 0.1


class ScoredRun(NamedTuple):
    errors: pd.DataFrame
    metrics: dict[str, Any]
    events: pd.DataFrame
    brakings: pd.DataFrame | None = None
    commands: pd.DataFrame | None = None


def score_run(
    truth: pd.DataFrame,
    detections: pd.DataFrame,
    tracks: pd.DataFrame,
    seed: int = 0,
    driven: DriverSetup | None = None,
    unseen: pd.DataFrame | None = None,
) -> ScoredRun:
    """Score a run that is one stretch."""
    scorer = RunScorer(seed, driven)
    tables = scorer.add(truth, detections, tracks, unseen)
    return ScoredRun(metrics=scorer.metrics(), **{name.removesuffix(".parquet"): tables[name] for name in tables})


def traffic(steps: int = 100, vehicles: int = 20, seed: int = 0, clutter: float = 1.0):
    """A jam-like run in which vehicles come and go out of view and tracks are noisy, die and swap."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(steps), vehicles)
    vehicle = np.tile(np.arange(vehicles), steps)
    lane = vehicle % 5
    speed = 10.0 + lane
    lon = (vehicle // 5) * 12.0 + lane * 2.0 + speed * step * STEP_S
    lat = lane * 3.6 + 0.2 * np.sin(0.1 * step + vehicle)
    phase = rng.uniform(0, 2 * np.pi, vehicles)
    period = rng.uniform(3, 25, vehicles)
    visible_fraction = np.clip(0.5 + 0.8 * np.sin(2 * np.pi * step * STEP_S / period[vehicle] + phase[vehicle]), 0, 1)
    distance = np.abs(lon - speed.mean() * step * STEP_S - 20.0)
    in_range = distance < 40.0
    state = np.where(visible_fraction < 0.15, "hidden", np.where(visible_fraction < 0.7, "partial", "visible"))
    state = np.where(in_range, state, "out")
    truth = pd.DataFrame(
        {
            "step": step, "time_s": step * STEP_S, "episode": 0, "vehicle_id": np.array([f"car{v}" for v in vehicle]),
            "lon_m": lon, "lat_m": lat, "heading_rad": 0.0, "speed_mps": speed, "lat_speed_mps": 0.0,
            "accel_mps2": 0.0, "lane": lane + 1, "length_m": 4.7, "width_m": 1.9, "is_ego": vehicle == 0,
            "in_range": in_range, "visible_fraction": visible_fraction, "state": state,
        }
    )  # fmt: skip
    seen = in_range & (vehicle > 0) & (visible_fraction > 0.15) & (rng.random(len(step)) < 0.9)
    hits = pd.DataFrame(
        {
            "step": step[seen], "time_s": step[seen] * STEP_S, "lon_m": lon[seen] + rng.normal(0, 0.3, seen.sum()),
            "lat_m": lat[seen] + rng.normal(0, 0.2, seen.sum()), "truth_id": truth["vehicle_id"].to_numpy()[seen],
        }
    )  # fmt: skip
    n_clutter = int(clutter * steps)
    clutter_step = rng.integers(0, steps, n_clutter)
    noise = pd.DataFrame(
        {
            "step": clutter_step, "time_s": clutter_step * STEP_S, "lon_m": rng.uniform(0, 200, n_clutter),
            "lat_m": rng.uniform(0, 18, n_clutter), "truth_id": "",
        }
    )  # fmt: skip
    detections = pd.concat([hits, noise]).sort_values("step", kind="stable").reset_index(drop=True)
    drift = np.cumsum(rng.normal(0, 0.15, (steps, vehicles)), axis=0).ravel() * (visible_fraction < 0.15)
    life = vehicle + vehicles * (step // rng.integers(20, 400, vehicles)[vehicle])
    reported = in_range & (vehicle > 0) & (rng.random(len(step)) < 0.97)
    swap = rng.permutation(int(life.max()) + 1)
    track_id = np.where(step > steps // 2, swap[life], life)
    tracks = pd.DataFrame(
        {
            "step": step, "time_s": step * STEP_S, "track_id": track_id,
            "lon_m": lon + rng.normal(0, 0.8, len(step)) + drift, "lat_m": lat + rng.normal(0, 0.4, len(step)),
            "speed_mps": speed + rng.normal(0, 0.5, len(step)), "lat_speed_mps": rng.normal(0, 0.2, len(step)),
            "accel_mps2": 0.0, "std_lon_m": 0.8, "std_lat_m": 0.4, "std_speed_mps": 0.5, "existence": 0.99,
            "state": np.where(visible_fraction < 0.15, "hidden", "confirmed"),
        }
    )[reported]  # fmt: skip
    return truth, detections, tracks.drop_duplicates(["step", "track_id"]).reset_index(drop=True)


class Scene:
    """A run built by hand: vehicles and tracks at given positions, nothing random."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.truth, self.detections, self.tracks = [], [], []
        self.vehicle("ego", lon=0.0, is_ego=True)

    def vehicle(
        self, name, lon, lat=0.0, state="visible", detected=False, episode=0, is_ego=False, at=None, speed=10.0
    ):
        """Add a vehicle; arguments are constants or one value per step. ``at`` chooses the steps it exists at."""
        step = np.arange(self.steps) if at is None else np.asarray(at)
        table = pd.DataFrame(
            {
                "step": step, "time_s": step * STEP_S, "episode": episode, "vehicle_id": name, "lon_m": lon,
                "lat_m": lat, "speed_mps": speed, "lat_speed_mps": 0.0, "is_ego": is_ego, "state": state,
            }
        )  # fmt: skip
        table["in_range"] = table["state"] != "out"
        self.truth.append(table)
        seen = table[np.broadcast_to(detected, len(table))]
        self.detections.append(seen[["step", "time_s", "lon_m", "lat_m"]].assign(truth_id=name))
        return self

    def clutter(self, at, lon, lat=0.0):
        """Add detections that came from no vehicle, one at each step of ``at``."""
        step = np.asarray(at, dtype=np.int64)
        places = pd.DataFrame({"step": step, "time_s": step * STEP_S, "lon_m": lon, "lat_m": lat, "truth_id": ""})
        self.detections.append(places)
        return self

    def track(self, number, lon, lat=0.0, at=None, state="confirmed", speed=10.0, std=1.0):
        """Add a track; ``at`` chooses the steps that it is reported at."""
        step = np.arange(self.steps) if at is None else np.asarray(at)
        self.tracks.append(
            pd.DataFrame(
                {
                    "step": step, "time_s": step * STEP_S, "track_id": number, "lon_m": lon, "lat_m": lat,
                    "speed_mps": speed, "lat_speed_mps": 0.0, "std_lon_m": std, "std_lat_m": std, "std_speed_mps": std,
                    "state": state,
                }
            )
        )  # fmt: skip
        return self

    def tables(self):
        """Return truth, detections and tracks."""
        if not self.tracks:
            self.track(0, lon=0.0, at=np.zeros(0, dtype=np.int64))
        return tuple(pd.concat(rows, ignore_index=True) for rows in (self.truth, self.detections, self.tracks))
