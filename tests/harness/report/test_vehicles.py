import re

import numpy as np
import pytest

from harness.report.html_tables import vehicle_table
from tests.harness.recorded_scene import LAST_SEEN, SEEN_AGAIN


def rows_of(table):
    body = table.partition("<tbody>")[2]
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", body)]


def test_each_vehicles_times_errors_and_fate_are_told(run):
    # *far* is seen for 4.1 s and hidden for 1.9 s; 3 m off for 0.9 s of these, then its track is given up: 10 m.
    table, left_out = vehicle_table(run.errors, run.events, run.step_s)
    far, near = rows_of(table)
    hidden_steps = SEEN_AGAIN - LAST_SEEN - 1
    cost_m = (9 * 3.0 + (hidden_steps - 9) * 10.0) / hidden_steps
    assert [float(cell) for cell in far[1:3]] == [4.1, 1.9]
    assert far[5:] == [f"{100 * 9 / hidden_steps:.0f}", "3.00", f"{cost_m:.2f}", "1"]
    assert near[1:] == ["6.0", "0.0", "100", "0.10", "-", "-", "-", "0"]
    assert left_out == 0


def test_the_cost_of_all_vehicles_is_the_runs_hidden_cost_by_identity(run):
    rows = rows_of(vehicle_table(run.errors, run.events, run.step_s)[0])
    hidden_s, cost_m = np.array([[float(row[2]), float(row[7])] for row in rows if row[7] != "-"]).T
    expected_m = run.metrics["hidden"]["identity_cost_m"]
    assert (hidden_s * cost_m).sum() / hidden_s.sum() == pytest.approx(expected_m, abs=0.01)


def test_a_vehicle_leads_to_its_worst_moment_in_the_replay(run):
    far = rows_of(vehicle_table(run.errors, run.events, run.step_s)[0])[0][0]
    assert far == "<a href='#t=3.0&amp;vehicle=far'>far</a>", "where its track was given up"


def test_a_run_without_detections_has_no_such_table(run):
    assert vehicle_table(run.errors.iloc[:0], run.events.iloc[:0], 0.1) is None
