"""A run as a recording for the rerun viewer: the plane view, curves beside it, and a layout."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb

from harness.common import palette
from harness.export.curves import Curves, curves_of
from harness.export.lanes import lanes_of
from harness.running.finished import RecordedRun
from harness.storage.tables import floats, rows_of_steps
from mmpf.numerics.arrays import FloatArray

FILE = "run.rrd"
TIMELINE = "time"
HEIGHT_M = 1.5
FLAT_M = 0.05
CURVE_COLOURS = {
    "seen": palette.GREEN, "hidden": palette.VERMILION,
    "seen vehicles": palette.GREEN, "hidden vehicles": palette.VERMILION,
    "detections": palette.DETECTION_COLOUR, "tracks": palette.PURPLE, "tracks taken for hidden": palette.ORANGE,
}  # fmt: skip
EGO, CURVES = "ego", "curves"
SCENE = ("+ /road", "+ /truth", "+ /ego", "+ /detections", "+ /tracks")
VIEW_BACK_M, VIEW_HEIGHT_M = 60.0, 70.0


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``run.rrd``, shown with ``rerun run.rrd``.

    Entities are ``road``, ``truth``, ``ego``, ``detections`` and ``tracks``, and below ``curves`` the mean errors of
    seen and of hidden vehicles and how many there were of each.
    """
    path = folder / FILE
    with rr.RecordingStream("mmpf-harness", recording_id=run.config.title()) as recording:
        recording.save(str(path), default_blueprint=_layout(run))
        recording.log("road", _lanes(run), static=True)
        _send(recording, "truth", run.truth, _truth_columns(run))
        _send(recording, "detections", run.detections, _detection_columns(run))
        _send(recording, "tracks", run.reported, _track_columns(run))
        ego = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)]
        _send(recording, EGO, ego, rr.Points3D.columns(positions=_places(run, ego, HEIGHT_M)))
        recording.log(EGO, rr.Points3D.from_fields(colors=[_rgb([palette.EGO_COLOUR])[0]], radii=[0.3]), static=True)
        _send_curves(recording, curves_of(run))
        recording.flush()
    return [path]


def _layout(run: RecordedRun) -> rrb.Blueprint:
    """Return the scene from above and behind the ego, which the view follows, over the curves."""
    ego = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)][:1]
    (place,), (_, _, turn) = _places(run, ego, 0.0), run.in_plane(ego)
    back = VIEW_BACK_M * np.array([np.cos(turn[0]), np.sin(turn[0]), 0.0])
    above = place - back + [0.0, 0.0, VIEW_HEIGHT_M]
    eye = rrb.EyeControls3D(position=above, look_target=place, eye_up=[0.0, 0.0, 1.0], tracking_entity=EGO)
    scene = rrb.Spatial3DView(origin="/", contents=SCENE, name="scene", eye_controls=eye)
    curves = (
        rrb.TimeSeriesView(origin=f"{CURVES}/error_m", name="mean error, m"),
        rrb.TimeSeriesView(origin=f"{CURVES}/count", name="how many"),
    )
    panels = (rrb.TimePanel(state="collapsed", timeline=TIMELINE), rrb.SelectionPanel(state="collapsed"))
    return rrb.Blueprint(rrb.Vertical(scene, rrb.Horizontal(*curves), row_shares=[3, 1]), *panels)


def _send_curves(recording: Any, curves: Curves) -> None:  # noqa: ANN401
    for group, named in (("error_m", curves.error_m), ("count", curves.count)):
        for name, values in named.items():
            entity, there = f"{CURVES}/{group}/{name.replace(' ', '_')}", np.isfinite(values)
            if not there.any():
                continue
            recording.log(entity, rr.SeriesLines(names=name, colors=[_rgb([CURVE_COLOURS[name]])[0]]), static=True)
            times = rr.TimeColumn(TIMELINE, duration=curves.time_s[there])
            rr.send_columns(entity, [times], rr.Scalars.columns(scalars=values[there]), recording=recording)


def _send(recording: Any, entity: str, table: pd.DataFrame, columns: Any) -> None:  # noqa: ANN401
    """Send a table's columns with as many rows at each time as the table has there."""
    if not len(table):
        return
    steps = rows_of_steps(table).values()
    times = rr.TimeColumn(TIMELINE, duration=floats(table, "time_s")[[rows.start for rows in steps]])
    lengths = [rows.stop - rows.start for rows in steps]
    rr.send_columns(entity, [times], columns.partition(lengths), recording=recording)


def _truth_columns(run: RecordedRun) -> Any:  # noqa: ANN401
    truth = run.truth
    half = 0.5 * truth[["length_m", "width_m"]].to_numpy(dtype=np.float64)
    colours = truth["state"].map(palette.STATE_COLOURS).astype("object").to_numpy(copy=True)
    colours[truth["is_ego"].to_numpy(dtype=bool)] = palette.EGO_COLOUR
    return rr.Boxes3D.columns(
        centers=_places(run, truth, 0.5 * HEIGHT_M),
        half_sizes=np.column_stack([half, np.full(len(half), 0.5 * HEIGHT_M)]),
        quaternions=_turns(run, truth),
        colors=_rgb(colours),
        labels=truth["vehicle_id"].astype("object").tolist(),
        show_labels=[False] * len(truth),
    )


def _detection_columns(run: RecordedRun) -> Any:  # noqa: ANN401
    count = len(run.detections)
    return rr.Points3D.columns(
        positions=_places(run, run.detections, HEIGHT_M + 0.1),
        colors=_rgb([palette.DETECTION_COLOUR] * count),
        radii=np.full(count, 0.25),
    )


def _track_columns(run: RecordedRun) -> Any:  # noqa: ANN401
    spread = palette.ELLIPSE_SCALE * run.reported[["std_lon_m", "std_lat_m"]].to_numpy(dtype=np.float64)
    return rr.Ellipsoids3D.columns(
        centers=_places(run, run.reported, HEIGHT_M + 0.1),
        half_sizes=np.column_stack([spread, np.full(len(spread), FLAT_M)]),
        quaternions=_turns(run, run.reported),
        colors=_rgb([palette.PURPLE] * len(spread)),
        labels=[str(number) for number in run.reported["track_id"]],
        show_labels=[False] * len(spread),
    )


def _lanes(run: RecordedRun) -> Any:  # noqa: ANN401
    strips = [np.pad(line.points(run.road), ((0, 0), (0, 1))) for line in lanes_of(run).lines]
    return rr.LineStrips3D(strips, colors=_rgb([palette.LANE_COLOUR] * len(strips)), radii=0.08)


def _places(run: RecordedRun, table: pd.DataFrame, height_m: float) -> FloatArray:
    x, y, _ = run.in_plane(table)
    return np.column_stack([x, y, np.full(len(x), height_m)])


def _turns(run: RecordedRun, table: pd.DataFrame) -> FloatArray:
    """Return quaternions (x, y, z, w) about the vertical, shape (n, 4)."""
    _, _, heading = run.in_plane(table)
    zero = np.zeros_like(heading)
    return np.column_stack([zero, zero, np.sin(0.5 * heading), np.cos(0.5 * heading)])


def _rgb(names: Any) -> Any:  # noqa: ANN401
    """Return colours given as #rrggbb as bytes, shape (n, 3)."""
    return np.array([tuple(bytes.fromhex(name[1:])) for name in names], dtype=np.uint8).reshape(-1, 3)
