"""Tables of ``metrics.json`` beside the scores: configuration, traffic and computing time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.config.model import RunConfig
from harness.running.follow import StageTimes
from harness.running.provenance import model_files
from harness.storage.schema import MODEL_FILE
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import LaneGraph
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


def timing_table(
    times: StageTimes, step_s: float, total_s: float, stages_ms: Mapping[str, Sequence[float]] | None = None
) -> dict[str, Any]:
    """Return the ``timing`` table; the real-time factor is simulated time over the wall time of the loop."""
    tracker_ms, sensor_ms, truth_ms = (
        1e3 * np.array(stage) for stage in (times.tracker_s, times.sensor_s, times.truth_s)
    )
    steps = len(times.tracker_s)
    loop_s = sum(times.tracker_s) + sum(times.waited_s)
    return {
        "steps": steps,
        "realtime_factor": steps * step_s / loop_s if loop_s > 0.0 else None,
        "tracker_ms": _percentiles(tracker_ms, 50, 95, 99),
        "sensor_ms": _percentiles(sensor_ms, 50),
        "truth_ms": _percentiles(truth_ms, 50),
        "total_s": total_s,
        "stages": {
            stage.replace(",", "").replace(" ", "_"): _percentiles(np.array(took_ms), 50, 95, 99)
            for stage, took_ms in (stages_ms or {}).items()
        },
    }


AROUND_EGO_M = 100.0


@dataclass
class TrafficSums:
    """Sums for the ``traffic`` table over a run that is processed part by part.

    Attributes:
        in_range: Vehicle-steps within the sensor's range, without the ego.
        inside: Vehicle-steps that count: on a lane of the section, or in the plane of the lanes around the ego.
        lane_km: In the plane the length of these lanes, summed over steps.
    """

    road: Road
    steps: int = 0
    in_range: float = 0.0
    inside: int = 0
    speed_mps: float = 0.0
    lane_km: float = 0.0

    def add(self, truth: pd.DataFrame) -> None:
        """Add the truth of a stretch."""
        road, lane = self.road, truth["lane"].to_numpy(dtype=np.int64)
        if isinstance(road, LaneGraphRoad):
            counted = self._around_ego(road.graph, truth, lane)
        else:
            counted = truth["lon_m"].between(*road.section_m).to_numpy() & (lane != NO_LANE)
        speeds = truth["speed_mps"].to_numpy(dtype=np.float64)[counted]
        self.steps += truth["step"].nunique()
        self.inside += len(speeds)
        self.speed_mps += float(speeds.sum())
        if "is_ego" in truth:
            self.in_range += float(truth["in_range"][~truth["is_ego"].to_numpy(dtype=bool)].sum())

    def _around_ego(self, graph: LaneGraph, truth: pd.DataFrame, lane: IntArray) -> BoolArray:
        """Return which vehicles are on lanes near the ego, and add these lanes' length; a stretch comes once."""
        segments, in_junction = graph.segments, graph.in_junction
        open_road = ~in_junction[segments.lane]
        middle_x = (segments.start_x + 0.5 * segments.length_m * segments.cosine)[open_road]
        middle_y = (segments.start_y + 0.5 * segments.length_m * segments.sine)[open_road]
        length_m = segments.length_m[open_road]
        egos = truth[truth["is_ego"].to_numpy(dtype=bool)].set_index("step")[["lon_m", "lat_m"]]
        for ego_x, ego_y in egos.to_numpy(dtype=np.float64):
            near = np.hypot(middle_x - ego_x, middle_y - ego_y) <= AROUND_EGO_M
            self.lane_km += float(length_m[near].sum()) / 1e3
        away_m = truth[["lon_m", "lat_m"]].to_numpy() - egos.reindex(truth["step"]).to_numpy()
        near = np.hypot(*away_m.T) <= AROUND_EGO_M
        return np.asarray(near & (lane != NO_LANE) & ~np.append(in_junction, False)[lane - 1])

    def summary(self) -> dict[str, float]:
        """Return density (per km and main lane), flow (all lanes) and speed over section and time, after Edie (1963).

        Density is the time that all vehicles spent over the section's area in space and time, flow the distance that
        they travelled over that area, speed the ratio. Lanes count where they run through the whole section, vehicles
        where they are on a lane: those on ramps are left out. In the plane the area is that of the lanes within 100 m
        of the ego, paths across junctions left out, and the flow is that of a mean lane.
        """
        start, end = self.road.section_m
        main_lanes = sum(1 for lane in self.road.lanes if lane.start_m <= start and lane.end_m >= end)
        vehicles_per_km = 0.0
        if self.inside and isinstance(self.road, LaneGraphRoad):
            vehicles_per_km = self.inside / self.lane_km if self.lane_km else 0.0
        elif self.inside:
            vehicles_per_km = self.inside / self.steps / ((end - start) / 1e3)
        if not vehicles_per_km:
            return {"density_veh_per_km_lane": 0.0, "flow_veh_per_h": 0.0, "mean_speed_mps": math.nan}
        mean_speed = self.speed_mps / self.inside
        return {
            "density_veh_per_km_lane": vehicles_per_km / max(main_lanes, 1),
            "flow_veh_per_h": vehicles_per_km * mean_speed * 3.6,
            "mean_speed_mps": mean_speed,
        }

    def table(self) -> dict[str, Any]:
        """Return the ``traffic`` table: what was achieved on the section, and how many vehicles were in range."""
        return {**self.summary(), "vehicles_in_range": self.in_range / self.steps if self.steps else None}


def identification(config: RunConfig) -> dict[str, Any]:
    """Return the ``run`` table: what was run."""
    traffic_config, tracker = config.traffic, config.tracker
    models = [f"{Path(name).name} {digest[:8]}" for name, digest in model_files(config).items()]
    return {
        "net": traffic_config.net,
        "demand": traffic_config.demand,
        "density": traffic_config.density,
        "duration_s": traffic_config.duration_s,
        "sensor": config.sensor.profile,
        "tracker": tracker.name,
        "model": tracker.model,
        **({MODEL_FILE: models[0]} if models else {}),
        "update": tracker.update,
        "particles": tracker.particles,
        "driver": config.decisions.driver,
        "seed": config.seed,
    }


def _percentiles(values: FloatArray, *percents: int) -> dict[str, float | None]:
    return {f"p{percent}": float(np.percentile(values, percent)) if len(values) else None for percent in percents}
