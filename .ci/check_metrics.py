"""Check that a ``metrics.json`` has every key that other programs rely on, and that the run kept pace."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from harness.scoring.metrics.registry import completed, quantities
from harness.storage.grid_folder import flattened

TIMES = ("steps", "realtime_factor", "total_s", "tracker_ms.p50", "tracker_ms.p95", "tracker_ms.p99")
TRAFFIC = ("density_veh_per_km_lane", "flow_veh_per_h", "mean_speed_mps", "vehicles_in_range")
KEYS = {
    *flattened(completed({})),
    *(quantity.key for quantity in quantities() if not quantity.is_of_some_runs),
    *(f"timing.{name}" for name in (*TIMES, "sensor_ms.p50", "truth_ms.p50")),
    *(f"traffic.{name}" for name in TRAFFIC),
    "mae.by_seconds_hidden.0.lon_m",
}


def main(path: Path) -> str:
    """Return what is wrong, or nothing."""
    metrics: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    missing = KEYS - set(flattened(metrics))
    if missing:
        return f"{path}: {', '.join(sorted(missing))} missing"
    if metrics["timing"]["realtime_factor"] < 1.0:
        return f"{path}: slower than real time, factor {metrics['timing']['realtime_factor']:.2f}"
    return ""


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])) or 0)
