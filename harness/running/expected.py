"""A guess of how long a run takes: right to a factor of two or so on a server core of 2024, and claiming no more."""

from __future__ import annotations

from harness.config.model import RunConfig

STEPS_PER_S = 10.0
OPENING_S, TRUTH_MS = 8.0, 15.0
FOLDER_S, SCORING_MS = 2.0, 10.0
LOADING_S = 15.0
"""What a process spends on loading what is compiled."""
USUAL_DENSITY, USUAL_PARTICLES = 30.0, 1000
# Milliseconds of a step for each vehicle per km and lane; the longest name that fits counts.
STEP_MS = {"": 1.0, "mmpf": 1.3, "oracle": 0.3, "stonesoup": 4.0, "stonesoup-gnn": 2.0}
# What of a step's time does not shrink with the particles.
LEAST_SHARE = 0.2


def expected_traffic_s(config: RunConfig) -> float:
    """Return the guess for the truth and the detections of a run, seconds."""
    return 0.0 if config.replay is not None else OPENING_S + 1e-3 * TRUTH_MS * _steps(config)


def expected_tracking_s(config: RunConfig) -> float:
    """Return the guess for what follows and scores them, seconds."""
    tracker = config.tracker
    fitting = max((name for name in STEP_MS if tracker.name.startswith(name)), key=len)
    share = (tracker.particles or USUAL_PARTICLES) / USUAL_PARTICLES if fitting == "mmpf" else 1.0
    vehicles_ms = STEP_MS[fitting] * (config.traffic.density or USUAL_DENSITY) * max(share, LEAST_SHARE)
    return FOLDER_S + 1e-3 * _steps(config) * (SCORING_MS + vehicles_ms)


def _steps(config: RunConfig) -> float:
    return STEPS_PER_S * config.traffic.duration_s
