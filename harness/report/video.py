"""A run as a film: the picture of each step, in the run's own time; needs the extra ``video``."""

import importlib.util
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg

from harness.common.errors import InputError
from harness.common.files import replacing
from harness.report.scene import PictureScene, scene_figure
from harness.running.finished import RecordedRun, read_recorded_run
from harness.running.recorder import tracks_of
from harness.running.replay import snapshots_of
from harness.storage.checks import sound_tables

DOTS_PER_INCH = 120


def write_video(folder: Path, path: Path, force: bool = False) -> Path:
    """Write a run as an MP4 film in its own time and return the file.

    Raises:
        InputError: The folder is no finished run's, or see ``check_film``.
    """
    check_film(path, force)
    import imageio_ffmpeg  # noqa: PLC0415  an extra that only films need

    run = read_recorded_run(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    with sound_tables(folder, "folder"), replacing(path) as pending:
        pictures = drawn_steps(run)
        height, width, _ = (first := next(pictures)).shape
        options = {"fps": 1.0 / run.step_s, "output_params": ["-f", "mp4"], "quality": 7}
        with closing(imageio_ffmpeg.write_frames(str(pending), (width, height), **options)) as film:
            film.send(None)
            film.send(first)
            for picture in pictures:
                film.send(picture)
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
    tracks, first = dict(list(run.reported.groupby("step"))), None
    for snapshot in snapshots_of(run.truth, run.detections, run.road, run.sensor):
        frame, here = snapshot.frame, tracks_of(tracks.get(snapshot.frame.step, run.reported[:0]))
        scene = PictureScene(frame, snapshot.observation, here, run.road, run.sensor.range_m)
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
        yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
