"""Runs in MLflow: on the server of ``MLFLOW_TRACKING_URI``, or else in a store of SQLite in the export's folder."""

import os
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from mlflow import MlflowClient
from mlflow.entities import Metric, Param, RunTag
from mlflow.exceptions import MlflowException

from harness.common.errors import InputError
from harness.export.experiments import PAGE, LoggedRun, files_in, logged_runs, register
from harness.storage.run_folder import final_of

ADDRESS, STORE, ARTIFACTS = "MLFLOW_TRACKING_URI", "mlflow.db", "artifacts"
MOST_AT_ONCE = 100
"""Limit of MLflow's on a batch of parameters or tags."""


def export(results: Path, folder: Path) -> list[Path]:
    """Log a run or a grid in an experiment of its folder's name; return ``logged.json`` and the store's files."""
    name, runs, page = results.resolve().name, logged_runs(results), results / PAGE
    if address := os.environ.get(ADDRESS):
        try:
            client = MlflowClient(address)
            known = client.get_experiment_by_name(name)
            ids = _log(client, known.experiment_id if known else client.create_experiment(name), runs)
            for number in ids.values() if page.is_file() else ():
                client.log_artifact(number, str(page))
        except MlflowException as error:
            problem = " ".join(str(error).split())[:200]
            raise InputError(f"`to` mlflow: {ADDRESS}={address}: {problem}; is it a store of MLflow?") from None
        return [register(folder, address, ids)]
    # The store tells where artifacts are by full paths, and the folder is about to be moved to its place.
    final = final_of(folder).resolve()
    # MLflow keeps a store open by its path, so each is written in a place of its own.
    with tempfile.TemporaryDirectory() as place:
        client = MlflowClient(f"sqlite:///{Path(place).resolve() / STORE}")
        ids = _log(client, client.create_experiment(name, (final / ARTIFACTS).as_uri()), runs)
        shutil.move(Path(place) / STORE, folder / STORE)
    for number in ids.values() if page.is_file() else ():
        own = folder / ARTIFACTS / number / "artifacts"
        own.mkdir(parents=True)
        shutil.copyfile(page, own / PAGE)
    register(folder, f"sqlite:///{final / STORE}", ids)
    return files_in(folder)


def _log(client: MlflowClient, experiment: str, runs: Sequence[LoggedRun]) -> dict[str, str]:
    """Log runs and return the identity of each by its name."""
    ids: dict[str, str] = {}
    for run in runs:
        now = time.time_ns() // 1_000_000
        number = ids[run.name] = client.create_run(experiment, now, run_name=run.name).info.run_id
        parts = (
            [Metric(key, value, now, 0) for key, value in run.metrics.items()],
            [Param(key, value) for key, value in run.settings.items()],
            [RunTag(key, value) for key, value in run.tags.items()],
        )
        for begin in range(0, max(map(len, parts)), MOST_AT_ONCE):
            client.log_batch(number, *(part[begin : begin + MOST_AT_ONCE] for part in parts))
        client.set_terminated(number, "FAILED" if run.tags.get("succeeded") == "False" else "FINISHED")
    return ids
