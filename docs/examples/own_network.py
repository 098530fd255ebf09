"""
A road of your own
==================

Any SUMO network can replace US-101: a ``.sumocfg`` with its own demand, or a folder with a ``network.toml``, for which
the harness keeps any density. This example writes such a folder, for a straight road of three lanes.
"""

# %%
# The road has three parts. Vehicles enter on ``approach``, are tracked on ``section``, and leave by ``outflow``. The
# harness needs the first and the last to keep the density in between. Make large networks with SUMO's netconvert or
# netedit. The file of a straight road is short: each edge with the centre lines of its lanes, a junction between edges,
# and which lane leads to which.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import harness

LANES = range(3)
WIDTH_M, LEFT_EDGE_M = 3.5, 10.5
EDGES_M = {"approach": (-400, -50), "section": (-50, 550), "outflow": (550, 850)}


def lane(edge, number, start, end):
    middle = (number + 0.5) * WIDTH_M
    return (
        f'<lane id="{edge}_{number}" index="{number}" speed="30" length="{end - start}" width="{WIDTH_M}" '
        f'shape="{start},{middle} {end},{middle}"/>'
    )


def junction(at, entering=None, kind="dead_end", requests=""):
    lanes = " ".join(f"{entering}_{number}" for number in LANES) if entering else ""
    return (
        f'<junction id="at{at}" type="{kind}" x="{at}" y="{LEFT_EDGE_M}" incLanes="{lanes}" intLanes="" '
        f'shape="{at},{LEFT_EDGE_M} {at},0">{requests}</junction>'
    )


def connection(before, after, number):
    return f'<connection from="{before}" to="{after}" fromLane="{number}" toLane="{number}" dir="s" state="M"/>'


requests = "".join(f'<request index="{number}" response="000" foes="000"/>' for number in LANES)
box = f"-400,0,850,{LEFT_EDGE_M}"
net_xml = "\n".join(
    [
        '<net version="1.20">',
        f'<location netOffset="0,0" convBoundary="{box}" origBoundary="{box}" projParameter="!"/>',
        *(
            f'<edge id="{edge}" from="at{start}" to="at{end}" priority="1">'
            + "".join(lane(edge, number, start, end) for number in LANES)
            + "</edge>"
            for edge, (start, end) in EDGES_M.items()
        ),
        junction(-400),
        junction(-50, "approach", "priority", requests),
        junction(550, "section", "priority", requests),
        junction(850, "outflow"),
        *(connection("approach", "section", number) for number in LANES),
        *(connection("section", "outflow", number) for number in LANES),
        "</net>",
    ]
)

# %%
# Three kinds of vehicles drive here, each with a base type that SUMO reads. Sizes and driving styles are drawn for each
# vehicle by the harness.

vehicles_xml = """<additional>
<vType id="car" vClass="passenger" carFollowModel="EIDM" laneChangeModel="SL2015" decel="2.0" speedDev="0"/>
<vType id="truck" vClass="truck" carFollowModel="EIDM" laneChangeModel="SL2015" decel="1.6" speedDev="0"/>
<vType id="motorcycle" vClass="motorcycle" carFollowModel="EIDM" laneChangeModel="SL2015" decel="2.5" speedDev="0"/>
</additional>
"""

# %%
# ``network.toml`` says what SUMO's file does not: which edges are the main road, which stretch of it is scored, in
# metres along the road, and on which lanes the car with the sensor may drive. Lane 1 is the leftmost.

network_toml = """description = "a straight road of three lanes"
net_file = "road.net.xml"
vehicle_types_file = "vehicles.add.xml"
corridor = ["approach", "section", "outflow"]
corridor_start_m = -400.0
section_m = [0.0, 500.0]
ego_lanes = [2]
"""

folder = Path(tempfile.mkdtemp())
road = folder / "three-lanes"
road.mkdir()
(road / "road.net.xml").write_text(net_xml)
(road / "vehicles.add.xml").write_text(vehicles_xml)
(road / "network.toml").write_text(network_toml)

# %%
# That is all; on the command line it is ``--net three-lanes``.

run = harness.run(net=road, density=40, seed=2, duration=8.0, tracker="mmpf", model="cvm", out=folder / "run")
run.metrics.loc[["traffic.density_veh_per_km_lane", "mot.hota", "mot.id_switches"]]

# %%
# Each line below is one vehicle on the scored section, coloured by its speed; the black line is the ego's. Where lines
# are flat, the traffic is slow.

truth = run.truth[run.truth["lon_m"].between(0.0, 500.0)]
figure, axes = plt.subplots(figsize=(9, 4), layout="constrained")
dots = axes.scatter(truth["time_s"], truth["lon_m"], c=truth["speed_mps"], s=2, cmap="viridis")
ego = run.truth[run.truth["is_ego"]]
axes.plot(ego["time_s"], ego["lon_m"], color="black", linewidth=2, label="ego")
axes.set(xlabel="time (s)", ylabel="position along the road (m)", ylim=(0.0, 500.0))
axes.legend(loc="upper left")
figure.colorbar(dots, label="speed (m/s)")
plt.show()
