"""The figures of one run: one moment from above, errors over time and by visibility, and the filter's diagnostics."""

from __future__ import annotations

from pathlib import Path

from harness.common.charts import draw_charts
from harness.report.run_charts import diagnostics_charts, error_charts, visibility_charts
from harness.report.scene import PictureScene, scene_figure
from harness.running.run import Pictured

SCENE, OVER_TIME, BY_VISIBILITY = "scene.png", "error_over_time.png", "error_by_visibility.png"
DIAGNOSTICS = "diagnostics.png"


def draw_figures(folder: Path, pictured: Pictured) -> None:
    """Draw all figures of a run into a new folder."""
    folder.mkdir()
    title, moment = pictured.title, pictured.moment
    if moment is not None:
        snapshot = moment.snapshot
        scene = PictureScene(
            snapshot.frame,
            snapshot.observation,
            moment.tracks,
            pictured.road,
            pictured.sensor.range_m,
            moment.particles,
        )
        scene_figure(scene, f"{title}: {snapshot.frame.time_s:.1f} s").savefig(folder / SCENE)
    draw_charts(error_charts(pictured.errors), title, folder / OVER_TIME)
    draw_charts(visibility_charts(pictured.metrics["mae"]), title, folder / BY_VISIBILITY)
    if pictured.diagnostics is not None:
        draw_charts(diagnostics_charts(pictured.diagnostics), title, folder / DIAGNOSTICS)
