from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from harness.report.figures import NAMES, error_by_visibility, error_over_time


def errors_of(**columns: object) -> pd.DataFrame:
    """Return a table of errors of one vehicle that is visible for 10 s, with some columns replaced."""
    steps = np.arange(100)
    table = {
        "step": steps, "time_s": steps * 0.1, "episode": 0, "state": "visible", "outcome": "tracked",
        "lon_error_m": -0.5, "lat_error_m": 0.25, "speed_error_mps": 1.0,
    }  # fmt: skip
    return pd.DataFrame({**table, **columns})


def lines_of(table: pd.DataFrame) -> list[list[np.ndarray]]:
    """Return each panel's lines, visible first, as heights."""
    figure = error_over_time(table, "title")
    return [[line.get_ydata() for line in axes.get_lines()[:3]] for axes in figure.axes]


def test_the_mean_of_absolute_errors_is_drawn_per_visibility():
    lon, lat, speed = (panel[0] for panel in lines_of(errors_of()))
    for heights, mean in ((lon, 0.5), (lat, 0.25), (speed, 1.0)):
        assert heights == pytest.approx(mean)
    assert all(len(panel[2]) == 0 for panel in lines_of(errors_of()))


def test_vehicles_that_no_track_follows_have_no_error():
    lost = errors_of(outcome=["lost"] * 50 + ["tracked"] * 50)
    lon = lines_of(lost)[0][0]
    assert np.isnan(lon[: len(lon) // 2]).all()
    assert lon[len(lon) // 2 :] == pytest.approx(0.5)


def test_a_new_ego_is_marked_where_it_begins():
    figure = error_over_time(errors_of(episode=[0] * 40 + [1] * 60), "title")
    marked = [text.xy[0] for text in figure.axes[0].texts if text.get_text() == "new ego"]
    assert marked == pytest.approx([4.0])


def test_bars_show_means_intervals_and_samples():
    row = {"lon_m": 1.5, "lat_m": 0.5, "speed_mps": 2.0, "lon_m_ci95": [1.0, 2.5], "n": 30}
    nothing = {"lon_m": None, "lat_m": None, "speed_mps": None, "n": 0}
    axes = error_by_visibility({"visible": row, "partial": row, "hidden": nothing}, "title").axes[0]
    assert [bar.get_height() for bar in axes.patches] == [1.5, 1.5]
    assert axes.get_ylim()[1] > 2.5
    labels = [label.get_text() for label in axes.get_xticklabels()]
    assert labels == [f"{NAMES['visible']}\nn = 30", f"{NAMES['partial']}\nn = 30", f"{NAMES['hidden']}\nn = 0"]
    assert "none" in [text.get_text() for text in axes.texts]


def test_a_run_without_any_error_row_still_draws():
    error_over_time(errors_of().iloc[:0], "title").canvas.draw()
