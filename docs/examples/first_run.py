"""
A first run
===========

Five seconds of dense traffic on the US-101 section: SUMO simulates the cars, the lidar of one car detects what the
other cars do not hide, and the Modified Mixture Particle Filter tracks the detections.
"""

# %%
# One call does all of it. The density is in vehicles per kilometre and lane. All random numbers follow from ``seed``,
# so equal arguments give equal results.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.patches import Ellipse, Rectangle

import harness

folder = Path(tempfile.mkdtemp())
run = harness.run(net="us101", density=45, seed=3, duration=5.0, tracker="mmpf", model="gmm", out=folder / "first")

# %%
# ``run.metrics`` has every number of ``metrics.json`` under a dotted name. HOTA rates detection and association of
# vehicles *in sight*; 100 % is perfect. The errors are mean absolute errors along the road, in metres, by how much of
# the vehicle the sensor sees. The error of a hidden vehicle is that of the track that was matched to it when it was
# last detected. :doc:`/explanation/scores` explains each name.

names = ["mot.hota", "mot.id_switches", "mae.visible.lon_m", "mae.partial.lon_m", "mae.hidden.lon_m"]
run.metrics.loc[names]

# %%
# The tables of the run folder come as data frames: ``run.truth``, ``run.detections``, ``run.tracks`` and
# ``run.errors``. Here is the last moment from above, in SI units. Green vehicles are in plain view, orange ones partly
# hidden, red outlines hidden; the ego, which carries the sensor, is black. According to the filter, a
# vehicle is within its dashed ellipse with 95 % probability. Ellipses of hidden vehicles are longer. An outline without
# an ellipse is a vehicle that was never detected, or whose track has ended.

step = run.truth["step"].max()
vehicles = run.truth[(run.truth["step"] == step) & (run.truth["in_range"] | run.truth["is_ego"])]
tracks = run.tracks[(run.tracks["step"] == step) & (run.tracks["state"] != "tentative")]
ego = vehicles[vehicles["is_ego"]].iloc[0]
colours = {"visible": "#009E73", "partial": "#E69F00"}

figure, axes = plt.subplots(figsize=(11, 3.2), layout="constrained")
for vehicle in vehicles.itertuples():
    corner = (vehicle.lon_m - ego.lon_m - vehicle.length_m / 2, vehicle.lat_m - vehicle.width_m / 2)
    face = "black" if vehicle.is_ego else colours.get(vehicle.state, "none")
    edge = "#D55E00" if vehicle.state == "hidden" and not vehicle.is_ego else "none"
    axes.add_patch(Rectangle(corner, vehicle.length_m, vehicle.width_m, facecolor=face, edgecolor=edge))
for track in tracks.itertuples():
    size = 2 * 2.45 * track.std_lon_m, 2 * 2.45 * track.std_lat_m
    centre = (track.lon_m - ego.lon_m, track.lat_m)
    axes.add_patch(Ellipse(centre, *size, fill=False, edgecolor="#882255", linestyle="--"))
axes.set(xlim=(-102, 102), ylim=(-5, 20), xlabel="position ahead of the ego (m)", ylabel="lateral position (m)")
axes.set_title(f"{len(tracks)} tracks around the ego at the end of the run", loc="left")
plt.show()

# %%
# The folder also has a page to open in a browser, which replays the run.

print(run.report().name, "beside", ", ".join(sorted(path.name for path in run.folder.glob("*.parquet"))))
