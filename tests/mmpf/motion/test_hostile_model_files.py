"""Model files that would fill the memory are refused by their headers, before an array is read."""

import io
import os
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

import mmpf
from mmpf.motion.gmm.model_file import MOST_ARRAYS, ModelFileError, load_arrays
from mmpf.motion.learned.driver import load_driver_model

KEEPING = Path(mmpf.__file__).parent / "models" / "lane_keeping.npz"


def header(shape: tuple[int, ...], dtype: str = "<f8") -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue()


def array(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, values)
    return stream.getvalue()


HOSTILE = {
    "an array nobody uses, well compressed": {"unused.npy": array(np.zeros(10_000_000))},
    "a header without its numbers": {"unused.npy": header((10**12,))},
    "a header whose size overflows": {"unused.npy": header((2**62, 2**62))},
    "objects": {"unused.npy": header((5,), "|O") + bytes(40)},
    "no array": {"unused.npy": b"hello"},
    "many arrays": {f"{number}.npy": array(np.zeros(1)) for number in range(MOST_ARRAYS + 1)},
}


@pytest.mark.parametrize("entries", HOSTILE.values(), ids=HOSTILE.keys())
def test_an_archive_beyond_the_limits_is_refused_at_once(entries, tmp_path):
    path = tmp_path / "model.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("case.test.npy", array(np.ones(1)))
        for name, content in entries.items():
            archive.writestr(name, content)
    begin = time.perf_counter()
    with pytest.raises(ModelFileError, match=r"model\.npz") as told:
        load_arrays(path, "test")
    assert "\n" not in str(told.value)
    assert time.perf_counter() - begin < 2.0


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ModelFileError, match="regular file"):
        load_arrays(tmp_path / "pipe", "test")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("following.output_scale", 1e300, "no driving has"),
        ("following.input_low", 1e4, "input_low is above"),
        ("following.output_scale", -1.0, "not positive"),
        ("spread", -1.0, "below 0"),
        ("free", -1.0, "below 0"),
        ("lateral", -1.0, "below 0"),
        ("intention", -1.0, "below 0"),
        ("spread", 1e-300, "byte order"),
    ],
)
def test_numbers_that_no_driving_has_are_refused(name, change, words, tmp_path):
    with np.load(KEEPING) as stored:
        arrays = {entry: stored[entry] for entry in stored.files}
    path = tmp_path / "model.npz"
    np.savez(path, **{**arrays, name: change * (np.abs(arrays[name]) + 1.0)})
    with pytest.raises(ModelFileError, match=words):
        load_driver_model(path)
    np.savez(path, **arrays)
    assert load_driver_model(path)
