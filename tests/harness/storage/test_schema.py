"""What a table's declaration says is what is written, read, checked and explained."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from harness.common.errors import InputError
from harness.running import recorder
from harness.running.finished import read_recorded_run
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage.run_folder import TRUTH, read_table
from harness.storage.schema import REPORTED_STATES, SCHEMA_VERSION, TABLES, VERSION_KEY, Column
from harness.truth.frame import Frame
from mmpf.scan import BodyHeadings, BodySizes, Detections
from mmpf.tracks import TRACK_STATES
from tests.harness.stand_ins import SteadyTraffic, observing
from tests.test_docs import script

pytestmark = pytest.mark.usefixtures("read_here")


@dataclass(frozen=True)
class LitFrame(Frame):
    """A frame that tells who brakes by its lights."""

    lights: np.ndarray | None = None


class LitTraffic(SteadyTraffic):
    def frames(self) -> Iterator[Frame]:
        for frame in super().frames():
            yield LitFrame(**vars(frame), lights=np.where(np.arange(len(frame)) % 2 == 0, "red", "off"))


def recorded(folder: Path, traffic: SteadyTraffic, tracker: str = "tests.harness.stand_ins:echo_tracker") -> Path:
    config = resolve_run_config(options={"tracker": tracker, "seed": 4})
    return run(config, out=folder, open_snapshots=observing(traffic)).folder


@pytest.mark.slow
def test_a_new_column_of_the_truth_needs_its_declaration_and_its_value_alone(tmp_path, monkeypatch):
    lights = Column("string", "lights", "brake lights", absent="it is day", words=("off", "red"))
    truth = TABLES[TRUTH]
    monkeypatch.setitem(TABLES, TRUTH, replace(truth, columns=(*truth.columns, replace(lights, words=()))))
    monkeypatch.setattr(recorder, "Frame", LitFrame)
    lit = recorded(tmp_path / "lit", LitTraffic(steps=3))
    unlit = recorded(tmp_path / "unlit", SteadyTraffic(steps=3))
    assert "lights" not in read_recorded_run(unlit).truth
    rows = read_recorded_run(lit).truth
    assert rows["lights"].tolist() == 3 * 9 * ["red", "off"]
    assert recorder.frame_of(rows[rows["step"] == 0]).lights.tolist() == 9 * ["red", "off"]
    assert "| `lights` | string |  | brake lights; absent where it is day |" in script().tables_page(TABLES)
    monkeypatch.setitem(TABLES, TRUTH, replace(truth, columns=(*truth.columns, replace(lights, words=("off", "on")))))
    with pytest.raises(InputError, match=r"truth\.parquet: lights holds 'red'; there are off, on$"):
        read_recorded_run(lit)


@pytest.mark.slow
def test_every_table_of_a_run_is_as_declared(tmp_path):
    folder = recorded(tmp_path / "run", SteadyTraffic(steps=15), "mmpf")
    files = sorted(folder.glob("*.parquet"))
    assert {path.name for path in files} == set(TABLES) - {"runs.parquet"}
    for path in files:
        written, table = pq.read_schema(path), TABLES[path.name]
        declared = [column for column in table.columns if not column.absent or column.name in written.names]
        assert written.names == [column.name for column in declared], path.name
        assert written.types == [pa.type_for_alias(column.type) for column in declared], path.name
        assert written.metadata[VERSION_KEY.encode()] == str(SCHEMA_VERSION).encode()


def test_trackers_get_those_columns_of_the_detections_that_say_so():
    given = {field.name for kind in (Detections, BodySizes, BodyHeadings) for field in fields(kind)}
    told = {column.name for column in TABLES["detections.parquet"].columns if column.trackers}
    assert told - {"time_s", "std_heading_rad"} == given - {"sizes", "headings", "std_rad"}
    assert not any(column.trackers for column in TABLES[TRUTH].columns)
    assert REPORTED_STATES == TRACK_STATES


@pytest.mark.parametrize("version", [None, SCHEMA_VERSION, SCHEMA_VERSION + 1, "new"])
def test_a_table_of_a_version_to_come_is_refused_and_one_of_none_is_read(version, tmp_path):
    metadata = {} if version is None else {VERSION_KEY: str(version)}
    pq.write_table(pa.table({"a": [1]}, metadata=metadata), tmp_path / "t.parquet")
    if version in (None, SCHEMA_VERSION):
        pd.testing.assert_frame_equal(read_table(tmp_path, "t.parquet", "folder", ["a"]), pd.DataFrame({"a": [1]}))
        return
    with pytest.raises(InputError, match=rf"^`folder`: .*t\.parquet has {VERSION_KEY} .*install a newer program$"):
        read_table(tmp_path, "t.parquet", "folder", ["a"])
