"""A run as a film: the picture of each step, in the run's own time; needs the extra ``video``."""

import importlib.util
from collections.abc import Iterator
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg

from harness.common.errors import InputError
from harness.common.files import replacing
from harness.common.progress import progress_bar
from harness.report.scene import PictureScene, scene_figure
from harness.running.finished import RecordedRun, read_recorded_run
from harness.running.recorder import tracks_of
from harness.running.replay import snapshots_of
from harness.storage.checks import sound_tables

DOTS_PER_INCH = 120
BLOCK = 16
"""Films have whole blocks of so many pixels."""


def write_video(folder: Path, path: Path, force: bool = False, quiet: bool = True) -> Path:
    """Write a run as an MP4 film in its own time, with a progress bar unless it is quiet, and return the file.

    Raises:
        InputError: The folder is no finished run's, or see ``check_film``.
    """
    check_film(path, force)
    import imageio_ffmpeg  # noqa: PLC0415  an extra that only films need

    run = read_recorded_run(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    steps = run.truth["step"].nunique()
    with sound_tables(folder, "folder"), replacing(path) as pending, progress_bar("drawing", steps, quiet) as advance:
        pictures = drawn_steps(run)
        height, width, _ = (first := next(pictures)).shape
        options = {"fps": 1.0 / run.step_s, "output_params": ["-f", "mp4"], "quality": 7}
        with closing(imageio_ffmpeg.write_frames(str(pending), (width, height), **options)) as film:
            film.send(None)
            for picture in chain([first], pictures):
                film.send(picture)
                advance()
    return path


def check_film(path: Path, force: bool) -> None:
    """Check beforehand whether a video can be written.

    Raises:
        InputError: The file exists or does not end in ``.mp4``, or the part of the package that writes films is not
            installed.
    """
    if path.suffix != ".mp4":
        raise InputError(f"`video`: {path} must end in .mp4")
    if path.exists() and not force:
        raise InputError(f"`video`: {path} exists; choose another file or add `force` to replace it")
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise InputError("`video`: needs imageio-ffmpeg; install it with: pip install -c constraints.txt '.[video]'")


def drawn_steps(run: RecordedRun) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield the road from above at each step, in colours of shape (height, width, 3), all of one size."""
    tracks, first, range_m = dict(list(run.reported.groupby("step"))), None, run.sensor.range_m
    across_m = None if run.road.has_headings else _edges_of(run)
    for snapshot in snapshots_of(run.truth, run.detections, run.road, run.sensor):
        frame, here = snapshot.frame, tracks_of(tracks.get(snapshot.frame.step, run.reported[:0]))
        scene = PictureScene(frame, snapshot.observation, here, run.road, range_m, across_m=across_m)
        figure = scene_figure(scene, f"{run.config.title()}: {frame.time_s:.1f} s")
        figure.set_dpi(DOTS_PER_INCH)
        if first is not None:  # all are laid out alike: nothing jumps, and drawing takes less time
            figure.set_size_inches(*first.get_size_inches())
            figure.set_layout_engine("none")
            for axes, same in zip(figure.axes, first.axes, strict=True):
                axes.set_position(same.get_position(original=True))
        first = first or figure
        canvas: Any = FigureCanvasAgg(figure)
        canvas.draw()
        drawn = np.asarray(canvas.buffer_rgba())[..., :3]
        below, right = (-size % BLOCK for size in drawn.shape[:2])
        yield np.pad(drawn, ((0, below), (0, right), (0, 0)), constant_values=255)


def _edges_of(run: RecordedRun) -> tuple[float, float]:
    """Return the lowest and highest lateral position of the lanes that come into range."""
    range_m, egos = run.sensor.range_m, run.truth[run.truth["is_ego"].astype(bool)]
    places = egos[["lon_m", "lat_m"]].to_numpy(dtype=np.float64)
    edges = [run.road.across_m((lon - range_m, lon + range_m), lat, range_m) for lon, lat in places]
    return min(low for low, _ in edges), max(high for _, high in edges)
