"""On networks in the plane the number of vehicles is held by how many the flows let in."""

import pytest

from harness.truth.sumo.inflow import MOST_SCALE, Inflow, scale_for


class Traffic:
    """Stands in for SUMO: flows of so many vehicles a second at scale 1, each of which leaves after a time."""

    def __init__(self, flow_per_s: float, stay_s: float) -> None:
        self.flow, self.stay = 0.1 * flow_per_s, stay_s
        self.scale, self.due, self.time_s, self.leave_s = 1.0, 0.0, 0.0, []
        self.vehicle = self.simulation = self

    def getIDCount(self):  # noqa: N802
        return len(self.leave_s)

    def getPendingVehicles(self):  # noqa: N802
        return ()

    def setScale(self, scale):  # noqa: N802
        self.scale = scale

    def step(self):
        self.time_s += 0.1
        self.due += self.scale * self.flow
        while self.due >= 1.0:
            self.due -= 1.0
            self.leave_s.append(self.time_s + self.stay)
        self.leave_s = [time_s for time_s in self.leave_s if time_s > self.time_s]


@pytest.mark.parametrize("density", [8.0, 20.0])
@pytest.mark.parametrize("stay_s", [40.0, 80.0])
def test_the_density_is_reached_and_held_whatever_the_flows_of_the_network(density, stay_s):
    lanes_m = 3000.0
    target = density * lanes_m / 1000.0
    traffic = Traffic(flow_per_s=target / 50.0, stay_s=stay_s)
    inflow = Inflow(traffic, density, lanes_m)
    counts = []
    for _ in range(6000):
        inflow.before_step(0.0)
        traffic.step()
        counts.append(traffic.getIDCount())
    assert inflow.reached
    late = counts[3000:]
    assert sum(late) / len(late) == pytest.approx(target, rel=0.06)
    assert max(late) <= 1.15 * target + 1.0


def test_who_waits_to_enter_counts_and_too_many_close_the_entries():
    assert scale_for(0, 40.0) == MOST_SCALE
    assert scale_for(40, 40.0) == pytest.approx(0.5 * MOST_SCALE)
    assert scale_for(43, 40.0) == 0.0
