"""Check that a ``metrics.json`` has every key that other programs rely on, and that the run kept pace."""

from __future__ import annotations

import json
import sys
from pathlib import Path

MOT = "hota deta assa idf1 mota id_switches fragmentations missed false_tracks"
KEYS = {
    **{f"mae.{group}": "lon_m lat_m speed_mps lat_speed_mps n" for group in ("all", "visible", "partial", "hidden")},
    "mae": "by_seconds_hidden",
    "mot": MOT,
    "mot_all": MOT,
    "gospa": "mean localisation missed false",
    "occlusion": "events survived hijacked lost same_id median_reacquire_s",
    "calibration": "nees",
    "calibration.coverage95": "lon lat speed",
    "timing": "steps realtime_factor total_s",
    "timing.tracker_ms": "p50 p95 p99",
    "timing.sensor_ms": "p50",
    "timing.truth_ms": "p50",
    "traffic": "density_veh_per_km_lane flow_veh_per_h mean_speed_mps vehicles_in_range",
}


def main(path: Path) -> str:
    """Return what is wrong, or nothing."""
    metrics = json.loads(path.read_text(encoding="utf-8"))
    for place, names in KEYS.items():
        table = metrics
        for part in place.split("."):
            table = table.get(part, {})
        missing = set(names.split()) - set(table)
        if missing:
            return f"{path}: {place} lacks {', '.join(sorted(missing))}"
    if metrics["timing"]["realtime_factor"] < 1.0:
        return f"{path}: slower than real time, factor {metrics['timing']['realtime_factor']:.2f}"
    return ""


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])) or 0)
