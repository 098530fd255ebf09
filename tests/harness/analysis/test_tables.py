"""A grid's tables and curves hold what its points hold, in words and numbers that are known beforehand."""

from dataclasses import replace

import pytest

from harness.analysis.curves import Point, curve_quantities, table_quantities
from harness.analysis.mismatch_cost import STOPPED_NOTE
from harness.analysis.tables import as_markdown, print_result, value_cell

# Quantities that only some roads have stand in tables with a row for each manoeuvre or cause.
OF_SOME_ROADS = {quantity.key for quantity in table_quantities() if quantity.is_of_some_runs}


def points(*, axis: str = "density", places=(20.0, 45.0), labels=("mmpf", "jpda"), without=()) -> list[Point]:
    """Return points of every quantity; no two of them have the same mean, and each interval is one wide."""
    found = []
    for label in labels:
        for value in places:
            for quantity in table_quantities():
                mean = 1.0 + len(found)
                interval = None if value == places[0] else (mean - 0.5, mean + 0.5)
                point = Point(label, axis, value, quantity.key, mean, interval, 3, 7)
                found.append(replace(point, mean=None, ci95=None, seeds=0) if quantity.key in without else point)
    return found


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def sections(text: str) -> dict[str, list[list[str]]]:
    """Return each table's lines as cells, by the line of words above it."""
    found: dict[str, list[list[str]]] = {}
    above = ""
    for line in text.splitlines():
        if line.startswith("|"):
            found.setdefault(above, []).append(cells(line))
        elif line:
            above = line
    return found


def test_every_point_stands_in_the_row_of_its_tracker_and_place_below_its_quantity():
    made = [point for point in points() if point.metric not in OF_SOME_ROADS]
    found = sections(as_markdown("T", made, [], []))
    told = {quantity.label: quantity for quantity in table_quantities()}
    seen = 0
    for lines in found.values():
        headings, rule, *rows = lines
        assert headings[:2] == ["tracker", "density"]
        assert headings[-1] == "seeds"
        assert rule == ["---"] * len(headings)
        assert [row[:2] for row in rows] == [["mmpf", "20"], ["mmpf", "45"], ["jpda", "20"], ["jpda", "45"]]
        for row in rows:
            assert row[-1] == "3"
            for heading, cell in zip(headings[2:-1], row[2:-1], strict=True):
                quantity = told[heading]
                point = next(p for p in made if (p.label, f"{p.value:g}", p.metric) == (row[0], row[1], quantity.key))
                digits = quantity.decimals
                low_high = "" if row[1] == "20" else f" [{point.mean - 0.5:.{digits}f}, {point.mean + 0.5:.{digits}f}]"
                assert cell == f"{point.mean:.{digits}f}{low_high}"
                seen += 1
    assert seen == len(made)
    assert [as_markdown("T", of, [], []).count(STOPPED_NOTE) for of in (points(), made)] == [1, 0]


@pytest.mark.parametrize(
    ("mean", "ci95", "with_interval", "cell"),
    [
        (1.234, (1.0, 2.0), True, "1.23 [1.00, 2.00]"),
        (1.234, (1.0, 2.0), False, "1.23"),
        (1.234, None, True, "1.23"),
        (None, None, True, "-"),
    ],
)
def test_a_cell_holds_a_mean_and_its_interval_as_far_as_there_are_any(mean, ci95, with_interval, cell):
    assert value_cell(Point("a", "density", 20.0, "k", mean, ci95, 1, 1), 2, with_interval) == cell


def test_on_eighty_columns_no_number_is_cut_and_the_trackers_stand_beside_each_part(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    made = points(labels=("my_kf:HungarianKalman", "mmpf gmm"))
    print_result("Title", made, [], [], "results/x")
    *lines, command = capsys.readouterr().err.splitlines()
    assert command.endswith("compare results/x@my_kf:HungarianKalman 'results/x@mmpf gmm'"), "it can be copied whole"
    shown = "\n".join(lines)
    assert "…" not in shown
    assert max(map(len, lines)) <= 80
    decimals = {each.key: each.decimals for each in curve_quantities()}
    means = [f"{point.mean:.{decimals[point.metric]}f}" for point in made if point.metric in decimals]
    assert set(means) <= set(shown.split())
