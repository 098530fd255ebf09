"""Files of fitted networks: read back as written, and refused where damaged."""

import numpy as np
import pytest

from mmpf.motion.gmm.model_file import ModelFileError, load_arrays, save_arrays
from mmpf.motion.learned.driver import recurrent_driver, residual_driver
from mmpf.motion.learned.network_file import save_network
from mmpf.motion.learned.recurrent import load_recurrent
from mmpf.motion.learned.residual import load_residual

KINDS = {"recurrent": (recurrent_driver, load_recurrent), "residual": (residual_driver, load_residual)}


@pytest.mark.parametrize("kind", KINDS)
def test_a_network_is_read_back_as_it_was_written(kind, tmp_path):
    driver, load = KINDS[kind]
    network = driver().model.follower.network
    save_network(tmp_path / "own.npz", kind, network._asdict())
    for mine, read in zip(network, load(tmp_path / "own.npz").network, strict=True):
        np.testing.assert_array_equal(mine, read)


@pytest.mark.parametrize(("kind", "name"), [("recurrent", "u"), ("residual", "w2")])
def test_a_file_that_holds_no_network_is_refused(kind, name, tmp_path):
    driver, load = KINDS[kind]
    path = tmp_path / "own.npz"
    save_network(path, kind, driver().model.follower.network._asdict())
    save_arrays(path, load_arrays(path, kind) | {name: np.zeros((3, 2))})
    with pytest.raises(ModelFileError, match=name):
        load(path)
