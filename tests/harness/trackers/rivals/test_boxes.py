import numpy as np
import pytest

from harness.trackers.rivals.boxes import FlatBoxes, generalised_overlap


def boxes(rows: list[tuple[float, ...]]) -> FlatBoxes:
    return FlatBoxes(*np.array(rows, dtype=float).T)


def test_known_pairs_have_their_known_overlap():
    octagon = 8.0 * (np.sqrt(2.0) - 1.0)
    square = (0.0, 0.0, 2.0, 2.0, 0.0)
    others = [
        (square, 1.0),
        ((1.0, 0.0, 2.0, 2.0, 0.0), 2.0 / 6.0),
        ((2.0, 0.0, 2.0, 2.0, 0.0), 0.0),
        ((4.0, 0.0, 2.0, 2.0, 0.0), -4.0 / 12.0),
        ((0.0, 0.0, 1.0, 1.0, 0.3), 0.25),
        # Turned by 45 degrees: an octagon is common, and the enclosing square has the side of the diagonal.
        ((0.0, 0.0, 2.0, 2.0, np.pi / 4), octagon / (8.0 - octagon) - octagon / 8.0),
    ]
    found = generalised_overlap(boxes([square] * len(others)), boxes([box for box, _ in others]))
    assert found == pytest.approx([known for _, known in others])


def test_turned_boxes_overlap_as_their_polygons_do():
    affinity = pytest.importorskip("shapely.affinity")
    geometry = pytest.importorskip("shapely.geometry")
    rng = np.random.default_rng(3)
    rows = [
        [(*rng.uniform(-3, 3, 2), *rng.uniform(0.5, 6.0, 2), rng.uniform(-4, 4)) for _ in range(200)] for _ in range(2)
    ]

    def polygon(x, y, length, width, heading):
        box = geometry.box(-length / 2, -width / 2, length / 2, width / 2)
        return affinity.translate(affinity.rotate(box, heading, origin=(0, 0), use_radians=True), x, y)

    for first, second, found in zip(*rows, generalised_overlap(boxes(rows[0]), boxes(rows[1])), strict=True):
        one, two = polygon(*first), polygon(*second)
        union = one.union(two).area
        # The enclosing rectangle is in line with the first box.
        in_line = affinity.rotate(one.union(two), -first[4], origin=(0, 0), use_radians=True)
        enclosing = in_line.envelope.area
        assert found == pytest.approx(one.intersection(two).area / union - (enclosing - union) / enclosing, abs=1e-9)


def test_which_frame_boxes_are_told_in_makes_no_difference():
    rng = np.random.default_rng(5)
    first, second = (rng.uniform([-2, -2, 1, 1, -3], [2, 2, 5, 3, 3], (50, 5)) for _ in range(2))
    here = generalised_overlap(boxes(first), boxes(second))
    turn, shift = 0.7, np.array([1000.0, -300.0])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for box in (first, second):
        box[:, :2] = box[:, :2] @ rotation.T + shift
        box[:, 4] += turn
    assert generalised_overlap(boxes(first), boxes(second)) == pytest.approx(here, abs=1e-9)
