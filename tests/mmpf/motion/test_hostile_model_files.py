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

MODELS = sorted((Path(mmpf.__file__).parent / "models").glob("*.npz"))


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
    with pytest.raises(ModelFileError, match=r"\A.*model\.npz.*\Z"):
        load_arrays(path, "test")
    assert time.perf_counter() - begin < 2.0


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ModelFileError, match="regular file"):
        load_arrays(tmp_path / "pipe", "test")


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_file_of_which_any_array_was_altered_renamed_or_left_out_is_refused(path, tmp_path):
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    case = next(name.removeprefix("case.") for name in arrays if name.startswith("case."))
    assert load_arrays(path, case).keys() == arrays.keys() - {"sha256"}
    for name, values in arrays.items():
        rest = {other: held for other, held in arrays.items() if other != name}
        for changed in (rest, rest | {name: np.nextafter(values, 9.0)}, rest | {f"{name}2": values}):
            np.savez(tmp_path / "own.npz", **changed)
            with pytest.raises(ModelFileError, match=rf"own\.npz is not for {case}|own\.npz was altered"):
                load_arrays(tmp_path / "own.npz", case)
