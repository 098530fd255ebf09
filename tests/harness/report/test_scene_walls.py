import numpy as np
import pytest
import shapely

from harness.report.scene import shadow_outlines
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.scan import EgoPose
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import detections_at

EGO = EgoPose(20.0, 0.0, 0.0, 0.0, 4.7, 1.9)


@pytest.mark.parametrize("far_end_m", [8.0, 400.0])
def test_the_drawn_shadow_of_a_wall_is_what_lies_behind_it_within_range(far_end_m: float) -> None:
    walls = np.array([[30.0, -8.0, 30.0, far_end_m]])
    road = LaneGraphRoad(graph=graph_of({"there": [(-200, 0), (200, 0)]}), walls_xy=walls)
    (outline,) = shadow_outlines(detections_at([]), EGO, road, 100.0, EGO.lon_m)
    shadow = shapely.Polygon(outline)
    x, y = np.random.default_rng(0).uniform(-100.0, 100.0, (2, 500))
    crossing = 10.0 * y / np.where(x > 0.0, x, np.nan)
    hidden = (x > 10.0) & (crossing > -8.0) & (crossing < far_end_m) & (np.hypot(x, y) < 100.0)
    edge = shadow.boundary.distance(shapely.points(x, y)) < 1.0
    assert (shapely.contains_xy(shadow, x, y) == hidden)[~edge].all()
    assert hidden.any()
