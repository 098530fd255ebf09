"""The vectorised rules equal the same rules written down as plain loops over steps and vehicles."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from tests.harness.scoring.scenes import STEP_S, score_run, traffic

STEPS = 250


@pytest.fixture(scope="module", params=[0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def run(request):
    truth, detections, tracks = traffic(steps=STEPS, vehicles=30, seed=request.param)
    return score_run(truth, detections, tracks), PlainLoops(truth, detections, tracks)


def test_outcomes_and_tracks_are_those_of_the_plain_loops(run):
    evaluation, plain = run
    table = evaluation.errors
    ours = {
        (row.step, row.vehicle_id): (row.outcome, row.track_id)
        for row in table[["step", "vehicle_id", "outcome", "track_id"]].itertuples()
    }
    assert ours == plain.outcomes
    assert {"tracked", "missed", "lost", "hijacked"} <= set(table["outcome"])


def test_occlusion_events_are_those_of_the_plain_loops(run):
    evaluation, plain = run
    events = evaluation.events
    ours = {
        (row.vehicle_id, row.from_step, row.to_step): (row.track_id, row.outcome)
        for row in events[["vehicle_id", "from_step", "to_step", "track_id", "outcome"]].itertuples()
    }
    assert len(ours) > 5
    assert ours == plain.events


class PlainLoops:
    """Outcomes by (step, vehicle) and events by (vehicle, onset step, return step), one step after the other."""

    def __init__(self, truth, detections, tracks):
        self.truth = {
            step: {row.vehicle_id: row for row in rows.itertuples() if not row.is_ego}
            for step, rows in truth.groupby("step")
        }
        self.tracks = {step: {row.track_id: row for row in rows.itertuples()} for step, rows in tracks.groupby("step")}
        self.seen_at = detections[detections["truth_id"] != ""].groupby("truth_id")["step"].agg(sorted).to_dict()
        self.matches = {step: self.match(step) for step in range(STEPS)}
        self.outcomes = {}
        for step in range(STEPS):
            for name, vehicle in self.truth[step].items():
                gap = self.steps_since_detection(name, step)
                if vehicle.in_range and gap is not None and gap <= 100:
                    self.outcomes[step, name] = self.outcome(step, name)
        self.events = dict(self.find_events())

    def steps_since_detection(self, name, step):
        before = [seen for seen in self.seen_at.get(name, []) if seen <= step]
        return step - before[-1] if before else None

    def match(self, step):
        """Return vehicle to track for the optimal assignment within the gate."""
        names = []
        for name, vehicle in self.truth[step].items():
            gap = self.steps_since_detection(name, step)
            if vehicle.in_range and (vehicle.state in ("visible", "partial") or (gap is not None and gap <= 5)):
                names.append(name)
        numbers = list(self.tracks.get(step, {}))
        gain = np.zeros((len(names), len(numbers)))
        for row, name in enumerate(names):
            for column, number in enumerate(numbers):
                alike = self.similarity(step, name, number)
                gain[row, column] = alike if alike >= 0.5 else 0.0
        rows, columns = linear_sum_assignment(gain, maximize=True)
        return {names[row]: numbers[column] for row, column in zip(rows, columns, strict=True) if gain[row, column] > 0}

    def similarity(self, step, name, number):
        vehicle, track = self.truth[step][name], self.tracks[step][number]
        return 1.0 - max(abs(vehicle.lon_m - track.lon_m) / 8.0, abs(vehicle.lat_m - track.lat_m) / 4.0)

    def holder(self, name, last_detection):
        for step in range(last_detection, max(last_detection - 6, -1), -1):
            if name in self.matches[step]:
                return self.matches[step][name]
        return None

    def outcome(self, step, name):
        if self.truth[step][name].state != "hidden":
            number = self.matches[step].get(name)
            return ("missed", -1) if number is None else ("tracked", number)
        number = self.holder(name, step - self.steps_since_detection(name, step))
        if number is None:
            return "untracked", -1
        if number not in self.tracks[step]:
            return "lost", -1
        for other, its_track in self.matches[step].items():
            if its_track == number and other != name:
                nearer = self.similarity(step, other, number) > max(0.0, self.similarity(step, name, number))
                return ("hijacked" if nearer else "tracked"), number
        return "tracked", number

    def find_events(self):
        for name, seen in self.seen_at.items():
            for onset, back in pairwise(seen):
                dark = [self.truth[step][name].state == "hidden" for step in range(onset + 1, back)]
                history = [step for step in seen if onset - round(3.0 / STEP_S) < step <= onset]
                judged = back + 5
                if not 5 <= back - onset <= 100 or np.mean(dark) < 0.7 or len(history) < 10:
                    continue
                if judged >= STEPS or not self.truth[judged][name].in_range:
                    continue
                number = self.holder(name, onset)
                owners = {its_track: owner for owner, its_track in self.matches[judged].items()}
                if number is None or number not in self.tracks[judged]:
                    result = "lost"
                elif owners.get(number) == name:
                    result = "same_id"
                else:
                    result = "hijacked" if number in owners else "survived"
                yield (name, onset, back), (-1 if number is None else number, result)
