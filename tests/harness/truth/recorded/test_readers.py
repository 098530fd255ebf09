"""Every layout of one scene gives the scene back: positions exact, motion as it was, nobody left out in silence."""

import gzip
import re

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.config.options import options_of
from harness.grid.options import GridOptions
from harness.grid.request import request_of
from harness.truth.recorded.formats import files_of, recognise
from tests.harness.truth.recorded.layouts import (
    CARS,
    EPOCH_MS,
    NGSIM_HEADER,
    Car,
    in_plane,
    ngsim_rows,
    opened,
    write_commonroad,
    write_fcd,
    write_highd,
    write_ngsim_csv,
    write_ngsim_text,
)

WRITERS = {
    "ngsim": lambda folder: write_ngsim_csv(folder / "scene.csv"),
    "ngsim-text": lambda folder: write_ngsim_text(folder / "scene.txt"),
    "commonroad": lambda folder: write_commonroad(folder / "scene.xml"),
    "highd": lambda folder: write_highd(folder / "scene"),
    "fcd": lambda folder: write_fcd(folder / "fcd.xml"),
}


def assert_same_frames(first, second):
    for one, other in zip(opened(first).frames(), opened(second).frames(), strict=True):
        np.testing.assert_array_equal(one.vehicle_id, other.vehicle_id)
        np.testing.assert_array_equal(one.lon_m, other.lon_m)


def by_name(frame) -> dict[str, int]:
    return {str(name): row for row, name in enumerate(frame.vehicle_id)}


@pytest.mark.parametrize("name", WRITERS)
def test_a_layout_is_recognised_by_its_content_whatever_its_name(name, tmp_path):
    written = WRITERS[name](tmp_path)
    renamed = written.rename(tmp_path / "anything.dat")
    assert recognise(renamed).name == name


@pytest.mark.parametrize("name", WRITERS)
def test_every_car_is_where_the_scene_has_it(name, tmp_path):
    """The accelerations that the files state are absurd ones beside constant speeds, and not believed."""
    lanes, lane_width_m = (3, 3.75) if name == "highd" else (5, 3.66)
    truth = opened(WRITERS[name](tmp_path))
    frames = list(truth.frames())
    assert len(frames) == truth.expected_steps == 51
    for frame in frames:
        rows = by_name(frame)
        present = [car for car in CARS if car.from_s - 1e-6 <= frame.time_s <= car.to_s + 1e-6]
        assert set(rows) == {str(car.name) for car in present}
        for car in present:
            row = rows[str(car.name)]
            wanted_lon, wanted_lat = car.lon_at(frame.time_s), car.lat_m
            found = frame.lon_m[row], frame.lat_m[row]
            if name == "commonroad":
                found = tuple(float(v) for v in truth.road.to_cartesian(np.array(found[0]), np.array(found[1])))
                wanted_lon, wanted_lat = in_plane(wanted_lon, wanted_lat, -0.7)
            assert found == pytest.approx((wanted_lon, wanted_lat), abs=1e-5)
            assert frame.speed_mps[row] == pytest.approx(car.speed_mps, abs=1e-5)
            assert frame.lat_speed_mps[row] == pytest.approx(0.0, abs=1e-4)
            assert frame.heading_rad[row] == pytest.approx(0.0, abs=1e-3)
            assert frame.length_m[row] == pytest.approx(car.length_m, abs=1e-5)
            assert frame.width_m[row] == pytest.approx(car.width_m, abs=1e-5)
            assert frame.accel_mps2[row] == pytest.approx(0.0, abs=1e-3)
            if car.lat_m < lanes * lane_width_m:
                assert frame.lane[row] == lanes - int(car.lat_m // lane_width_m)


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "highd"])
def test_a_packed_file_is_read_like_the_plain_one(name, tmp_path):
    written = WRITERS[name](tmp_path)
    packed = tmp_path / "packed.gz"
    packed.write_bytes(gzip.compress(written.read_bytes()))
    assert_same_frames(written, packed)


@pytest.mark.slow
def test_a_packed_file_that_is_cut_or_holds_too_much_is_refused_in_one_line(tmp_path, monkeypatch):
    packed = tmp_path / "fcd.xml.gz"
    content = gzip.compress(write_fcd(tmp_path / "fcd.xml").read_bytes())
    packed.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=r"fcd\.xml\.gz: broken or truncated gzip"):
        opened(packed)
    packed.write_bytes(content)
    packed.write_bytes(gzip.compress(b"<fcd-export>" + b"<a/>" * (1 << 20) + b"<b><!--" + b" " * (64 << 20)))
    monkeypatch.setattr("harness.common.isolation.ProcessLimits.cpu_s", 1)
    with pytest.raises(InputError, match=r"fcd\.xml\.gz \(fcd\): it took more than 1 s"):
        opened(packed)


def test_both_versions_of_commonroad_say_the_same(tmp_path):
    assert_same_frames(*(write_commonroad(tmp_path / f"{v}.xml", version=v) for v in ("2018b", "2020a")))


def test_commonroad_pedestrians_are_left_out_and_counted_and_parked_cars_stand_still(tmp_path):
    state = (
        "<initialState><position><point><x>48</x><y>-33</y></point></position><orientation><exact>-0.7</exact>"
        "</orientation><time><exact>0</exact></time></initialState>"
    )
    shape = "<shape><rectangle><length>4.0</length><width>1.7</width></rectangle></shape>"
    extra = (
        f'<dynamicObstacle id="900"><type>pedestrian</type>{shape}{state}</dynamicObstacle>'
        f'<staticObstacle id="901"><type>parkedVehicle</type>{shape}{state}</staticObstacle>'
    )
    truth = opened(write_commonroad(tmp_path / "scene.xml", extra=extra))
    assert truth.traffic.counts.left_out == {"on foot or bicycle": 1}
    assert truth.traffic.counts.vehicles_read == len(CARS) + 2
    frames = list(truth.frames())
    for frame in frames:
        row = by_name(frame)["901"]
        x, y = truth.road.to_cartesian(frame.lon_m[[row]], frame.lat_m[[row]])
        assert (float(x[0]), float(y[0])) == pytest.approx((48.0, -33.0))
        assert frame.speed_mps[row] == 0.0


def test_highd_drives_the_busier_carriageway_and_counts_the_other(tmp_path):
    upward = tuple(Car(100 + k, 20.0 + 15.0 * k, 2.0, 11.0) for k in range(6))
    truth = opened(write_highd(tmp_path / "scene", cars=CARS, upper=upward))
    assert truth.traffic.counts.left_out == {"on the other carriageway": len(CARS)}
    for frame in truth.frames():
        rows = by_name(frame)
        gaps = [frame.lon_m[rows[str(car.name)]] - car.lon_at(frame.time_s) for car in upward]
        np.testing.assert_allclose(gaps, gaps[0], atol=1e-5)
        np.testing.assert_allclose(frame.speed_mps, 11.0)
        np.testing.assert_allclose(frame.lat_m, 2.0, atol=1e-5)
        assert set(frame.lane) == {3}


def test_rows_a_second_apart_are_joined_by_a_curve_that_keeps_their_speeds(tmp_path):
    """With constant acceleration the cubic through positions and speeds is the motion itself."""
    lines = []
    for tick in range(6):
        x = 100.0 + 10.0 * tick + 0.5 * 1.5 * tick**2 + 2.0
        lines.append(
            f'<timestep time="{tick}"><vehicle id="a" x="{x}" y="9.0" angle="90" type="car" speed="{10 + 1.5 * tick}" '
            'length="4" width="2"/></timestep>'
        )
    path = tmp_path / "fcd.xml"
    path.write_text(f"<fcd-export>{''.join(lines)}</fcd-export>")
    frames = list(opened(path).frames())
    assert len(frames) == 51
    for frame in frames:
        t = frame.time_s
        assert frame.lon_m[0] == pytest.approx(100.0 + 10.0 * t + 0.75 * t**2, abs=1e-6)
        assert frame.accel_mps2[0] == pytest.approx(1.5, abs=1e-6)


def without_sizes(path):
    """Take the sizes out of floating-car data, as SUMO writes them by default."""
    path.write_text(re.sub(r' (length|width)="[^"]*"', "", path.read_text()))
    return path


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_fcd_sizes_come_from_the_types_declared_beside(suffix, tmp_path):
    path = without_sizes(write_fcd(tmp_path / "fcd.xml"))
    types = b'<additional><vType id="car" length="6.5" width="2.1"/></additional>'
    (tmp_path / f"fcd.vtypes.xml{suffix}").write_bytes(gzip.compress(types) if suffix else types)
    frame = next(iter(opened(path).frames()))
    assert (set(frame.length_m), set(frame.width_m)) == ({6.5}, {2.1})
    assert [file.name for file in files_of(path, "fcd")] == ["fcd.xml", f"fcd.vtypes.xml{suffix}"]
    assert request_of(dict.fromkeys(options_of(GridOptions)) | {"replay": tmp_path}).replay == (str(path),)


@pytest.mark.parametrize("types", ['<additional><vType id="car" width="wide"/></additional>', "<additional><vType", ""])
def test_fcd_types_that_are_broken_are_refused_in_one_line(types, tmp_path):
    path = without_sizes(write_fcd(tmp_path / "fcd.xml"))
    (tmp_path / "fcd.vtypes.xml").write_text(types)
    with pytest.raises(InputError, match=r"fcd\.xml: broken, or no floating-car data"):
        opened(path)


def test_fcd_vehicles_on_other_roads_are_left_out_and_counted(tmp_path):
    far = Car(77, 50.0, 400.0, 10.0)
    truth = opened(write_fcd(tmp_path / "fcd.xml", cars=(*CARS, far)))
    assert truth.traffic.counts.left_out == {"never within 15 m of the main road": 1}


def test_ngsim_duplicates_are_dropped_and_counted_wherever_they_lie(tmp_path):
    rows = ngsim_rows()
    contradicting = [*rows[9][:5], rows[9][5] + 10.0, *rows[9][6:]]
    doubled = [*rows, *rows[5:40], *rows[60:80:3], contradicting]
    truth = opened(write_ngsim_csv(tmp_path / "scene.csv", doubled))
    once = opened(write_ngsim_csv(tmp_path / "once.csv", rows))
    assert truth.traffic.counts.duplicates == 35 + 7 + 1
    assert truth.traffic.counts.contradictions == 1
    for one, other in zip(truth.frames(), once.frames(), strict=True):
        np.testing.assert_array_equal(one.lon_m, other.lon_m)


def test_an_ngsim_number_that_another_period_uses_again_is_another_vehicle(tmp_path):
    later = [[*row[:1], row[1], row[2], row[3] + 900_000, *row[4:]] for row in ngsim_rows(CARS[:1])]
    truth = opened(write_ngsim_csv(tmp_path / "scene.csv", [*ngsim_rows(), *later]), duration_s=1000.0)
    assert "7-2" in truth.traffic.names
    assert len(np.unique(truth.traffic.stay)) == len(CARS) + 1


def test_a_short_pause_is_filled_in_and_a_long_one_ends_the_stay(tmp_path):
    rows = ngsim_rows(CARS[:1])
    short = opened(write_ngsim_csv(tmp_path / "short.csv", [*rows[:20], *rows[24:]]))
    assert short.traffic.counts.filled == 4
    frame = list(short.frames())[22]
    assert frame.lon_m[0] == pytest.approx(CARS[0].lon_at(2.2), abs=1e-5)
    long = opened(write_ngsim_csv(tmp_path / "long.csv", [*rows[:20], *rows[35:]]))
    assert [str(name) for name in long.traffic.names] == ["7", "7-2"]


def test_of_several_sites_the_one_of_the_network_counts(tmp_path):
    elsewhere = [[*row, "i-80"] for row in ngsim_rows(CARS[:2])]
    here = [[*row, "us-101"] for row in ngsim_rows()]
    truth = opened(write_ngsim_csv(tmp_path / "scene.csv", [*elsewhere, *here]))
    assert truth.traffic.counts.left_out == {"at another site than us-101": 2}
    assert truth.traffic.counts.vehicles_kept == len(CARS)


def test_digits_grouped_by_commas_are_numbers_all_the_same(tmp_path):
    rows = [[*row[:3], f'"{row[3]:,}"', *row[4:]] for row in ngsim_rows()]
    truth = opened(write_ngsim_csv(tmp_path / "scene.csv", rows))
    assert f'"{EPOCH_MS:,}"' in (tmp_path / "scene.csv").read_text()
    assert truth.traffic.counts.vehicles_kept == len(CARS)


def test_the_columns_of_the_csv_may_come_in_any_order_and_case(tmp_path):
    names = NGSIM_HEADER.split(",")
    order = np.random.default_rng(1).permutation(len(names))
    rows = [[[*row, "us-101"][k] for k in order] for row in ngsim_rows()]
    lines = [",".join(names[k].lower() for k in order), *(",".join(map(str, row)) for row in rows)]
    path = tmp_path / "scene.csv"
    path.write_text("\n".join(lines) + "\n")
    assert opened(path).traffic.counts.vehicles_kept == len(CARS)


def test_a_recording_is_cut_to_the_seconds_asked_for_and_says_who_is_missing_then(tmp_path):
    truth = opened(write_ngsim_csv(tmp_path / "scene.csv"), duration_s=0.5)
    assert truth.expected_steps == 5
    assert truth.traffic.counts.left_out == {"on record only outside of the seconds used": 1}
    assert "1 on record only outside of the seconds used" in truth.report()


@pytest.mark.parametrize(("name", "net"), [("commonroad", "us101"), ("highd", "us101"), ("ngsim", "recording")])
def test_a_road_that_does_not_go_with_the_format_is_refused(name, net, tmp_path):
    with pytest.raises(InputError, match="`net`"):
        opened(WRITERS[name](tmp_path), net=net)


def test_a_rare_jump_in_a_large_recording_cuts_the_stay_and_is_told(tmp_path):
    fleet = [Car(k, 10.0 + 12.0 * k, 9.0, 10.0, to_s=0.5) for k in range(1, 150)]
    rows = ngsim_rows(fleet)
    rows[-2][5] += 100.0
    rows[-1][5] += 100.0
    truth = opened(write_ngsim_csv(tmp_path / "scene.csv", rows))
    assert len(np.unique(truth.traffic.stay)) == len(fleet) + 1
    assert "1 jumps" in truth.report()


def test_a_few_vehicles_in_another_unit_are_refused_however_large_the_recording(tmp_path):
    fleet = [Car(k, 10.0 + 12.0 * k, 9.0, 20.0, to_s=1.0) for k in range(1, 150)]
    rows = ngsim_rows(fleet)
    for row in rows[-11:]:
        row[11] *= 0.3048
    with pytest.raises(InputError, match=r"vehicle 149 .* units"):
        opened(write_ngsim_csv(tmp_path / "scene.csv", rows))


def test_a_stress_test_of_a_kitti_folder_takes_each_sequence(tmp_path):
    (tmp_path / "label_02").mkdir()
    labels = [tmp_path / "label_02" / name for name in ("0000.txt", "0001.txt")]
    for file in labels:
        file.touch()
    asked = request_of(dict.fromkeys(options_of(GridOptions)) | {"replay": tmp_path})
    assert asked.replay == tuple(map(str, labels))
