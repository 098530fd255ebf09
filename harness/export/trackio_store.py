"""Runs in Trackio: in the store of ``TRACKIO_DIR``, or else in one in the export's folder; always on this machine."""

import io
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from harness.common.errors import InputError
from harness.export.experiments import PAGE, LoggedRun, files_in, logged_runs, register
from harness.storage.run_folder import final_of

PLACE, ELSEWHERE = "TRACKIO_DIR", ("TRACKIO_SPACE_ID", "TRACKIO_SERVER_URL")
if find_spec("trackio") is None:
    raise ModuleNotFoundError("No module named 'trackio'", name="trackio")


def export(results: Path, folder: Path) -> list[Path]:
    """Log the runs of a folder in a project of its name; the files are as those of ``mlflow_store.export``."""
    place, runs, name = os.environ.get(PLACE), logged_runs(results), results.resolve().name
    page = results / PAGE
    # Trackio learns when it is imported where its store is, so a process of its own logs the runs.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        logging = pool.submit(_log, Path(place or folder).resolve(), name, runs, page if page.is_file() else None)
    if (error := logging.exception()) is not None:
        raise InputError(f"`to` trackio: {place or results}: {' '.join(str(error).split())[:200]}") from None
    file = register(folder, place or str(final_of(folder).resolve()), {run.name: name for run in runs})
    return [file] if place else files_in(folder)


def _log(place: Path, project: str, runs: Sequence[LoggedRun], page: Path | None) -> None:
    os.environ[PLACE] = str(place)
    for variable in ELSEWHERE:
        os.environ.pop(variable, None)
    trackio: Any = import_module("trackio")
    sys.stdout = io.StringIO()  # what it prints names a folder that is about to be moved
    for run in runs:
        config = {**run.settings, **{f"tag.{key}": value for key, value in run.tags.items()}}
        logged = trackio.init(project, run.name, config=config, embed=False, auto_log_gpu=False, auto_log_cpu=False)
        logged.log(dict(run.metrics), step=0)
        logged.finish()
    if page is not None:
        trackio.save(page, project)
