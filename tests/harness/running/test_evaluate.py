"""One evaluation for all: the same run whether it is in memory or written as it goes on."""

import json

import numpy as np

from harness.running.evaluate import evaluate, evaluation_of, write_run
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage import run_folder as runfolder
from tests.harness.stand_ins import EchoTracker, SteadyTraffic, observing

ECHO = {"tracker": "tests.harness.stand_ins:echo_tracker", "model_file": __file__}
CONFIG = resolve_run_config(options={**ECHO, "seed": 3})


def test_a_run_that_is_written_at_once_leaves_the_files_of_one_that_is_written_as_it_goes_on(tmp_path):
    evaluation = evaluation_of(CONFIG, observing(SteadyTraffic())(CONFIG))
    evaluation.follow()
    evaluated = evaluation.finish()
    write_run(tmp_path / "at_once", evaluated, evaluated.metrics(CONFIG, {}, 1.0), CONFIG, "test")
    run(CONFIG, out=tmp_path / "going_on", open_snapshots=observing(SteadyTraffic()), command="test")
    tables = {path.name for path in (tmp_path / "going_on").glob("*.parquet")}
    assert {runfolder.TRUTH, runfolder.UNSEEN, runfolder.ERRORS, runfolder.COMMANDS} <= tables
    for name in (*tables, runfolder.CONFIG, runfolder.ROAD):
        assert (tmp_path / "at_once" / name).read_bytes() == (tmp_path / "going_on" / name).read_bytes(), name
    told = ((runfolder.MANIFEST, part) for part in ("rows", "steps", "inputs_sha256"))
    for name, part in ((runfolder.METRICS, "mot"), *told):
        mine, theirs = (json.loads((tmp_path / kind / name).read_text())[part] for kind in ("at_once", "going_on"))
        assert mine
        assert mine == theirs, part


def test_nothing_is_expected_or_driven_where_the_tracker_alone_is_evaluated():
    evaluated = evaluate(observing(SteadyTraffic(steps=7))(CONFIG), EchoTracker, 3)
    assert evaluated.steps == 7
    assert evaluated.tables.keys() == {
        f"{name}.parquet" for name in ("truth", "detections", "tracks", "errors", "events")
    }
    errors = evaluated.tables[runfolder.ERRORS]["lon_error_m"].to_numpy(dtype=np.float64)
    assert 0.0 < np.nanmean(np.abs(errors)) < 1.0
