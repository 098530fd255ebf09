"""Writes a run as a video; what draws it is loaded only then."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from harness.common.errors import InputError
from harness.common.files import replacing
from harness.running.finished import read_recorded_run


def write_video(folder: Path, path: Path, force: bool = False) -> Path:
    """Write a run as an MP4 film in its own time and return the file.

    Raises:
        InputError: The folder is no finished run's, or see ``check_film``.
    """
    check_film(path, force)
    from harness.report.film import write_film  # noqa: PLC0415

    run = read_recorded_run(folder)
    if not run.road.lanes:
        raise InputError("`video`: films show one road from above, and this network has many; see the page's replay")
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as pending:
        write_film(run, pending)
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
