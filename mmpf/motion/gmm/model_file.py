"""Fitted models on disk: NumPy archives without pickled objects, checked before use."""

import hashlib
import math
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import BinaryIO

import numpy as np

from mmpf.motion.gmm.conditional import ConditionalGmm
from mmpf.motion.gmm.kernel import Scaling
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.numerics.arrays import FloatArray

MIXTURE_PARTS = ("weights", "means", "covariances", *Scaling._fields)
# No fitted model comes near to these.
MOST_ARRAYS, MOST_BYTES = 200, 64 * 1024 * 1024
DIGEST = "sha256"
"""Entry with the digest of all others: an altered number is noticed, however plausible it is."""
DAMAGE = (
    *(ValueError, EOFError, KeyError, AttributeError, TypeError, SyntaxError, OverflowError, NotImplementedError),
    *(RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error),
)


class ModelFileError(ValueError):
    """A model file that can't be used; the message is one line that names the file."""


def save_arrays(path: Path, arrays: Mapping[str, FloatArray]) -> None:
    """Write named arrays of numbers, and their digest, to an archive whose bytes depend on the numbers alone."""
    numbers = {name: np.asarray(values, dtype=np.float64) for name, values in arrays.items()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in sorted({**numbers, DIGEST: _digest(numbers)}.items()):
            with archive.open(zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0)), "w") as entry:
                np.lib.format.write_array(entry, values, allow_pickle=False)


def load_arrays(path: Path, case: str) -> dict[str, FloatArray]:
    """Read a model file of one case back.

    Args:
        path: The file.
        case: What the file must be for; it is stored as an entry's name, so that no other file passes for it.

    Raises:
        ModelFileError: The file is missing, damaged, of another kind, altered since it was written, or holds
            numbers that are not finite.
    """
    try:
        if path.exists() and not path.is_file():
            raise ModelFileError(f"model file {path} is not a regular file")
        with path.open("rb") as file:
            _check_headers(file, path)
            file.seek(0)
            with np.load(file, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
    except FileNotFoundError as error:
        raise ModelFileError(f"model file {path} does not exist; 'train' writes one") from error
    except OSError as error:
        raise ModelFileError(f"model file {path} can't be read: {_one_line(error)}") from error
    except ModelFileError:
        raise
    except DAMAGE as error:
        raise ModelFileError(f"model file {path} is damaged or no npz file; 'train' writes one") from error
    if f"case.{case}" not in arrays:
        kinds = ", ".join(name.removeprefix("case.") for name in arrays if name.startswith("case.")) or "none"
        raise ModelFileError(f"model file {path} is not for {case} (it says: {kinds}); make one with the train command")
    for name, values in arrays.items():
        if values.dtype != np.float64 or not np.isfinite(values).all():
            raise ModelFileError(f"model file {path}: {name} holds what is not finite or no number of 64 bits")
    if not np.array_equal(arrays.pop(DIGEST, np.zeros(0)), _digest(arrays)):
        raise ModelFileError(
            f"model file {path} was altered since it was written, or is of an older version; make it again with 'train'"
        )
    return arrays


def _digest(arrays: Mapping[str, FloatArray]) -> FloatArray:
    """Return the SHA-256 of names, shapes and numbers, a byte each, shape (32,)."""
    told = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        told.update(f"{name}{values.shape}".encode())
        told.update(values.astype("<f8").tobytes())
    return np.frombuffer(told.digest(), dtype=np.uint8).astype(np.float64)


def _check_headers(file: BinaryIO, path: Path) -> None:
    """Refuse an archive whose arrays would fill the memory, or are none, by their headers alone."""
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        if len(entries) > MOST_ARRAYS or len({entry.filename for entry in entries}) < len(entries):
            raise ModelFileError(f"model file {path} has {len(entries)} arrays, too many or some twice")
        if sum(entry.file_size for entry in entries) > MOST_BYTES:
            raise ModelFileError(f"model file {path} would unpack to more than {MOST_BYTES >> 20} MB")
        for entry in entries:
            with archive.open(entry) as stream:
                version = np.lib.format.read_magic(stream)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(stream)
            if math.prod(shape) * dtype.itemsize > entry.file_size:
                raise ModelFileError(f"model file {path}: {entry.filename[:60]} is larger than what is stored of it")


def mixture_arrays(prefix: str, fitted: ScaledGmm) -> dict[str, FloatArray]:
    """Return a mixture's numbers by name, as ``mixture_from_arrays`` expects them."""
    joint = fitted.mixture
    parts = (joint.weights, joint.means, joint.covariances, *fitted.scaling)
    return {f"{prefix}.{name}": values for name, values in zip(MIXTURE_PARTS, parts, strict=True)}


def mixture_from_arrays(path: Path, arrays: Mapping[str, FloatArray], prefix: str, size: tuple[int, int]) -> ScaledGmm:
    """Put a mixture of a model file together again.

    Args:
        path: The file, for messages.
        arrays: What ``load_arrays`` read.
        prefix: The mixture's name in the file.
        size: Numbers of inputs and outputs that it must have.

    Raises:
        ModelFileError: A part is missing, has the wrong shape, or the parts make no mixture.
    """
    inputs, outputs = size
    for name in MIXTURE_PARTS:
        if f"{prefix}.{name}" not in arrays:
            raise ModelFileError(f"model file {path} has no {prefix}.{name}")
    part = {name: arrays[f"{prefix}.{name}"] for name in MIXTURE_PARTS}
    for name in Scaling._fields:
        expected = (inputs if name.startswith("input") else outputs,)
        if part[name].shape != expected:
            raise ModelFileError(f"model file {path}: {prefix}.{name} has shape {part[name].shape}, not {expected}")
    if part["means"].ndim != 2 or part["means"].shape[1] != inputs + outputs:
        raise ModelFileError(
            f"model file {path}: {prefix}.means has shape {part['means'].shape}, not (components, {inputs + outputs})"
        )
    try:
        joint = ConditionalGmm(part["weights"], part["means"], part["covariances"], inputs)
    except ValueError as error:
        raise ModelFileError(f"model file {path}: {prefix}: {_one_line(error)}") from error
    return ScaledGmm(joint, Scaling(*(part[name] for name in Scaling._fields)))


@dataclass(frozen=True)
class MixtureFile:
    """A kind of model file that holds one mixture.

    Attributes:
        case: What the files are for.
        inputs: Number of inputs.
        outputs: Number of outputs.
    """

    case: str
    inputs: int
    outputs: int

    def load(self, path: Path) -> ScaledGmm:
        """Read a fitted mixture.

        Raises:
            ModelFileError: The file can't be used.
        """
        return mixture_from_arrays(path, load_arrays(path, self.case), "joint", (self.inputs, self.outputs))

    def save(self, path: Path, mixture: ScaledGmm) -> None:
        """Write a fitted mixture."""
        save_arrays(path, {f"case.{self.case}": np.ones(1), **mixture_arrays("joint", mixture)})


def committed_file(case: str) -> AbstractContextManager[Path]:
    """Lend the path of the model file of a case that travels with the package."""
    return as_file(files("mmpf.models").joinpath(f"{case.replace('-', '_')}.npz"))


@cache
def committed_mixture(kind: MixtureFile) -> ScaledGmm:
    """Return the mixture of that kind that travels with the package."""
    with committed_file(kind.case) as path:
        return kind.load(path)


def _one_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
