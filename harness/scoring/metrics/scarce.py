"""Refuses to score a run in which there is nothing to score."""

from collections.abc import Mapping
from typing import Any

from harness.common.errors import InputError

# A vehicle in sight in fewer than one step of so many says nothing of a tracker.
FEWEST_A_STEP = 0.05


def check_scored(metrics: Mapping[str, Any], steps: int, parameter: str = "net") -> None:
    """Refuse scores over no vehicle, or nearly none; ``parameter`` named the traffic.

    Raises:
        InputError: Vehicles were in sight in fewer than one vehicle-step in twenty of the scored steps.
    """
    in_sight = metrics["mot"]["truth_n"]
    if in_sight >= max(1.0, FEWEST_A_STEP * steps):
        return
    in_range = metrics["coverage"]["vehicles_in_range"]
    if not in_range:
        reason, fix = "no vehicle comes within the sensor's range", "choose other traffic or a longer range"
    elif not metrics["coverage"]["detected"]:
        reason, fix = "none of the vehicles in range is detected", "check the sensor's settings and the traffic"
    else:
        reason, fix = "vehicles are hardly ever in sight", "choose more traffic, a longer duration or a longer range"
    told = f"nothing can be scored: {in_sight} vehicle-steps in sight in {steps} steps, because {reason}; {fix}"
    raise InputError(f"`{parameter}`: {told}")
