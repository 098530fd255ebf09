"""Fields by Edie's definitions, from frames with known answers."""

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.lab.fidelity.fields import BIN_S, CELL_M, FIELD_FILES, FOOT_M, Fields, fields_from_frames, read_fields
from tests.harness.closedloop.frames import frame_of

STEP_S = 0.1


def frame(step, front_m, speed_mps, lane=None):
    sizes = {"length_m": np.full(len(front_m), 4.0), "width_m": np.full(len(front_m), 2.0)}
    lanes = {} if lane is None else {"lane": lane}
    return frame_of(np.array(front_m) - 2.0, np.zeros(len(front_m)), speed_mps, step, **sizes, **lanes)


def column(speed_mps, spacing_m, steps=100, cells=20):
    """Return frames of one lane of vehicles at even spacing, long enough to fill all cells at all times."""
    fronts = np.arange(-speed_mps * steps * STEP_S - spacing_m, cells * CELL_M + spacing_m, spacing_m)
    for step in range(steps):
        here = fronts + speed_mps * step * STEP_S
        yield frame(step, here, np.full(len(here), speed_mps))


def test_even_traffic_has_the_speed_density_and_flow_that_it_was_made_with():
    fields = fields_from_frames(column(speed_mps=12.0, spacing_m=3.0, steps=100), STEP_S, cells=20)
    assert np.allclose(fields.speed_mps, 12.0)
    assert fields.density_veh_per_m.mean() == pytest.approx(1.0 / 3.0, rel=0.01)
    assert fields.flow_veh_per_s.mean() == pytest.approx(4.0, rel=0.01)


def test_flow_is_density_times_speed_in_every_cell():
    rng = np.random.default_rng(0)
    frames = [frame(k, rng.uniform(0.0, 60.0, 30), rng.uniform(0.0, 20.0, 30)) for k in range(50)]
    fields = fields_from_frames(frames, STEP_S, cells=10)
    seen = fields.density_veh_per_m > 0.0
    product = fields.density_veh_per_m[seen] * fields.speed_mps[seen]
    assert np.allclose(fields.flow_veh_per_s[seen], product)
    assert np.isnan(fields.speed_mps[~seen]).all()


def test_one_standing_vehicle_fills_one_cell_by_its_front():
    frames = [frame(k, [CELL_M * 3.5], [0.0]) for k in range(50)]
    fields = fields_from_frames(frames, STEP_S, cells=6)
    expected = np.zeros(6)
    expected[3] = 1.0 / CELL_M
    assert np.allclose(fields.density_veh_per_m[:, 0], expected)


def test_vehicles_beside_the_lanes_and_beyond_the_cells_are_left_out():
    frames = [frame(k, [10.0, 10.0, -1.0, 61.0], [5.0] * 4, lane=[0, 2, 2, 2]) for k in range(50)]
    fields = fields_from_frames(frames, STEP_S, cells=10)
    assert fields.density_veh_per_m.sum() * CELL_M == pytest.approx(1.0)


def test_a_bin_that_is_not_full_is_dropped_and_none_at_all_is_refused():
    assert fields_from_frames(column(10.0, 5.0, steps=130), STEP_S, cells=20).speed_mps.shape == (20, 2)
    with pytest.raises(ValueError, match="no bin"):
        fields_from_frames(column(10.0, 5.0, steps=49), STEP_S, cells=20)


def test_a_stretch_of_time_is_cut_out_by_when_bins_begin():
    field = np.tile(np.arange(12.0), (3, 1))
    cut = Fields(field, field, field).between(2 * BIN_S, 5 * BIN_S)
    assert cut.speed_mps[0].tolist() == [2.0, 3.0, 4.0]


@pytest.fixture
def folder(tmp_path):
    for name in FIELD_FILES.values():
        np.savetxt(tmp_path / name, np.full((4, 6), 10.0))
    return tmp_path


def test_recorded_fields_are_turned_from_feet_into_metres(folder):
    fields = read_fields(folder)
    assert np.allclose(fields.speed_mps, 10.0 * FOOT_M)
    assert np.allclose(fields.flow_veh_per_s, 10.0)
    assert np.allclose(fields.density_veh_per_m, 10.0 / FOOT_M)


@pytest.mark.parametrize("content", [None, "", "a b c", "1 2\n3", "1 nan", "-1 2", "\0\1\2"])
def test_a_broken_table_is_one_clear_line(folder, content):
    path = folder / FIELD_FILES["flow"]
    path.unlink()
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match="`fields`"):
        read_fields(folder)
