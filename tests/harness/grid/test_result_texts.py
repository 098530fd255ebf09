"""The texts and figures of a grid, each from a small table that is made up."""

from __future__ import annotations

import re
from itertools import product

import numpy as np
import pandas as pd
import pytest

from harness.analysis import curves, tables
from harness.analysis.curves import breaks, curve_points
from harness.analysis.tables import as_markdown, print_result

TOLD = (
    *("hidden.hidden_cost_m", "mae.visible.lon_m", "mae.visible.n", "occlusion.same_id", "mot.hota"),
    *("manoeuvre.straight.position_m", "manoeuvre.left.position_m", "manoeuvre.left.same_id_percent"),
    *("hidden_by.building.hidden_cost_m", "unseen_turns.right_route_percent", "never_seen.log_skill_percent"),
    *("against_coasting.hidden.ratio", "timing.tracker_ms.p50"),
)
DRAWN = ("hidden.hidden_cost_m", "occlusion.same_id", "mot.hota", "timing.tracker_ms.p50")
TRACKERS = (("mmpf", "cvm"), ("mmpf+model=idm", "idm"), ("echo", None))


@pytest.fixture(autouse=True)
def _few_quantities(monkeypatch):
    """Let tables be of a few quantities of each kind, so that another metric leaves the texts here as they are."""
    known = {quantity.key: quantity for quantity in curves.table_quantities()}
    for module in (curves, tables):
        monkeypatch.setattr(module, "table_quantities", lambda: [known[key] for key in TOLD])
        monkeypatch.setattr(module, "curve_quantities", lambda: [known[key] for key in DRAWN])


def number(*key: object) -> float:
    """Return a number that looks drawn at random and is the same for the same words: 0.00 to 9.96."""
    return sum(ord(letter) * place for place, letter in enumerate(repr(key), 1)) % 997 / 100.0


def row(variant: str, model: str | None, seed: int, **other: object) -> dict[str, object]:
    key = (variant, seed, *other.values())
    made = {
        "net": "curve", "density": None, "demand": None, "variant": variant, "model": model, "seed": seed,
        "succeeded": True, "occlusion.same_id": 3 * number("kept", *key), "occlusion.events": 40.0,
        "hidden.n": 5.0 + seed, "mae.visible.n": 30.0 + seed, "mae.visible.of_n": 40.0, "manoeuvre.left.n": 4.0,
        "manoeuvre.left.events": 0.0, "manoeuvre.straight.n": 40.0, "hidden_by.building.n": 2.0,
        "unseen_turns.events": 3.0, "against_coasting.hidden.lon_m": 0.1 + 0.1 * number(*key),
        "against_coasting.hidden.n": 8.0,
        "against_coasting.hidden.coasting_lon_m": 2.0,
    }  # fmt: skip
    measured = set(TOLD) - set(made) - {"against_coasting.hidden.ratio", "never_seen.log_skill_percent"}
    made |= {name: 10.0 * number(name, *key) for name in sorted(measured)}
    return made | other


def two_networks() -> pd.DataFrame:
    """Return a grid of two networks and two ranges, in which a run failed and no left turn was lost."""
    rows = [
        row(variant, model, seed, net=net, demand="middle", **{"sensor.range_m": range_m})
        for net, range_m, (variant, model), seed in product(
            ("curve", "junction"), (40.0, 80.0), TRACKERS[:2], (0, 1, 2)
        )
    ]
    rows[1] |= {"succeeded": False, "hidden.hidden_cost_m": 1e9}
    rows[2] |= {"hidden.hidden_cost_m": None, "hidden.n": 0.0}
    for each in rows[::2]:
        each |= {"manoeuvre.left.position_m": None, "manoeuvre.left.n": 0.0}
    return pd.DataFrame(rows)


def densities() -> pd.DataFrame:
    """Return a grid over five densities in which trackers break between them, at the lowest, and not at all."""
    shares = {"mmpf": (99, 80, 52, 30, 35), "mmpf+model=idm": (40, 30, 20, 10, 60), "echo": (90, 80, 70, 60, 51)}
    rows = []
    for (variant, model), place, seed in product(TRACKERS, range(5), range(4)):
        kept = 0.1 * shares[variant][place] + 0.3 * (seed - 1)
        rows.append(row(variant, model, seed, density=10.0 * (place + 1), **{"occlusion.same_id": kept}))
        rows[-1] |= {"occlusion.events": 10.0 if place < 4 else 4.0}
    return pd.DataFrame(rows)


def test_a_point_is_the_mean_over_the_runs_that_ended_well():
    table = two_networks()
    points = curve_points(table, ["sensor.range_m"])
    (one,) = [
        point for point in points
        if (point.axis, point.value, point.label, point.metric) == ("net", "junction", "mmpf cvm", "mot.hota")
    ]  # fmt: skip
    chosen = table[(table["net"] == "junction") & (table["variant"] == "mmpf") & table["succeeded"]]
    assert one.mean == pytest.approx(chosen.groupby("seed")["mot.hota"].mean().mean())
    assert one.seeds == 3
    assert one.ci95[0] < one.mean < one.ci95[1]


def test_the_page_of_networks_and_ranges_has_its_axes_units_intervals_and_failures():
    table = two_networks()
    text = as_markdown("Made up", curve_points(table, ["sensor.range_m"]), breaks(table), ["seed 1: it broke"])
    assert text.startswith("# Made up\n")
    assert text.index("## By network") < text.index("sensor.range_m")
    assert "| tracker | network | hidden cost (10 m if lost), m | seeds |" in text
    assert re.search(r"\| mmpf cvm \| curve \| [\d.]+ \[[\d.]+, [\d.]+\] \| 3 \|", text)
    assert "- seed 1: it broke" in text


def test_the_page_of_densities_tells_where_each_tracker_breaks():
    table = densities()
    text = as_markdown("Made up", curve_points(table, []), breaks(table), [])
    rows = [line.split(" | ")[:2] for line in text.splitlines() if line.startswith("| mmpf cvm | ")]
    assert [int(density) for _, density in rows[:5]] == [10, 20, 30, 40, 50]
    found = {each.label: each for each in breaks(table)}
    assert 30.0 <= found["mmpf cvm"].density <= 40.0
    assert found["mmpf+model=idm"].at_lowest
    assert found["echo"].density is None


def test_a_tracker_is_judged_only_at_densities_of_twenty_occlusions_over_all_seeds():
    rows = [row("echo", None, seed, density=density) for density in (10.0, 20.0, 30.0) for seed in (0, 1)]
    for each, (kept, events) in zip(rows, ((9, 10), (8, 10), (4, 10), (3, 10), (0, 10), (0, 9)), strict=True):
        each |= {"occlusion.same_id": kept, "occlusion.events": events}
    (one,) = breaks(pd.DataFrame(rows))
    assert (one.density, one.held_to, one.at_lowest) == (10.0 + 10.0 * (85 - 50) / (85 - 35), 20.0, False)
    assert (one.ci95[0] is None, one.ci95[1] is None) == (False, False)
    for each in rows:
        each["occlusion.events"] = 1
    (none,) = breaks(pd.DataFrame(rows))
    assert none == curves.Break("echo", None, None, None, False)


def test_a_share_crosses_one_half_between_the_densities_beside_it_as_far_as_both_have_events():
    densities = np.array([10.0, 20.0, 40.0])
    counts = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    shares = np.array([[0.0, 80.0, 40.0], [90.0, 0.0, 40.0], [90.0, 50.0, 50.0], [49.0, 90.0, 10.0]])
    assert curves._crossings(densities, shares, counts).tolist() == [35.0, 40.0, np.inf, 10.0]


@pytest.mark.parametrize("columns", ["60", "160"])
def test_the_screen_shows_results_breaks_and_the_folder_narrow_and_wide(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    points = curve_points(two_networks(), ["sensor.range_m"])
    broken = [curves.Break("mmpf cvm", 33.3, (30.4, None), 45.0, False)]
    print_result("Made up", points, broken, [f"seed {k}: it broke" for k in range(11)], "out/folder")
    shown = capsys.readouterr().err
    assert [word for word in ("curve", "junction", "33", "seed 0: it broke", "out/folder") if word not in shown] == []
