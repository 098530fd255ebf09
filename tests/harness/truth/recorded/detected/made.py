"""Small recordings in the layouts of data sets, made up here: nothing of the data sets is in the project.

The recording car drives ahead at 5 m/s. A parked car stands 20 m ahead of its start and 3 m to the left, another car
drives 15 m ahead of it at the same speed, a pedestrian stands at the right. The driving car is not detected from step
10 to step 24, and there is one false detection in each step.
"""

from pathlib import Path

import numpy as np

STEPS, STEP_S, SPEED_MPS = 60, 0.1, 5.0
PARKED_XY, AHEAD_M = (20.0, 3.0), 15.0
GAP = range(10, 25)
SIZE = "1.5 1.8 4.4"


def camera_box(x_ahead_m: float, y_left_m: float) -> str:
    """Return x, y, z and turn of a box that points ahead, in the camera's frame."""
    return f"{-y_left_m:.6f} 1.7 {x_ahead_m:.6f} {-np.pi / 2:.8f}"


def write_kitti(folder: Path, sequence: str = "0000", steps: int = STEPS) -> Path:
    """Write a folder with one sequence and return it."""
    labels, detections, poses = [], [], []
    for step in range(steps):
        gone = step * STEP_S * SPEED_MPS
        parked = PARKED_XY[0] - gone, PARKED_XY[1]
        poses.append(f"1 0 0 0 0 1 0 0 0 0 1 {gone:.6f}")
        labels += [
            f"{step} -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1",
            f"{step} 1 Car 0 0 -1.5 500 150 600 200 {SIZE} {camera_box(*parked)}",
            f"{step} 2 Car 0 {2 if step in GAP else 0} -1.5 600 150 700 200 {SIZE} {camera_box(AHEAD_M, 0.0)}",
            f"{step} 3 Pedestrian 0 0 -1.5 700 150 720 200 1.7 0.6 0.6 {camera_box(10.0, -4.0)}",
        ]
        found = [(8.0, parked), (0.5, (30.0, -8.0))]
        found += [] if step in GAP else [(9.0, (AHEAD_M + 0.2, 0.1))]
        for score, place in found:
            box = f"{SIZE} {camera_box(*place)}".split()
            detections.append(",".join([str(step), "2", "500", "150", "600", "200", str(score), *box, "-1.5"]))
        detections.append(f"{step},1,1,1,2,2,7.0,1.7,.6,.6,4,1.7,10,0,0")
    for name, lines in (("label_02", labels), ("detection", detections), ("poses", poses)):
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / f"{sequence}.txt").write_text("\n".join(lines) + "\n")
    return folder
