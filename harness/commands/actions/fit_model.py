"""Fits a behaviour model, writes it and prints its figures."""

import json
from collections.abc import Mapping
from typing import Any

import typer

from harness.common.errors import InputError
from harness.config.lists import numbers, seed_values
from harness.lab.fit.train import EMPIRICAL, RECURRENT, RESIDUAL, TrainingPlan, train
from harness.lab.fit.turning_fit import ON_NETWORKS, TURNING, train_turning
from harness.lab.windows.recording import DENSITIES_VEH_PER_KM_LANE, FIRST_TRAINING_SEED, TRAINING_DURATION_S
from harness.storage.schema import DENSITY_RANGE
from harness.truth.network.network import load_network


def _densities(text: str | None) -> tuple[float, ...]:
    if text is None:
        return DENSITIES_VEH_PER_KM_LANE
    found = numbers(text, "densities", "20,40")
    for density in found:
        if not DENSITY_RANGE[0] <= density <= DENSITY_RANGE[1]:
            raise InputError(f"`densities` {density:g}: give {DENSITY_RANGE[0]:g} to {DENSITY_RANGE[1]:g}")
    return found


def fit_model(options: Mapping[str, Any]) -> None:
    """Run ``train`` with the given options; raises ``InputError`` where they are wrong."""
    case = options["case"]
    seeds = options["seeds"] or {"lane-change": "1000:1003"}.get(case, "1000:1002")
    traffic = seed_values(seeds)
    if traffic.start < FIRST_TRAINING_SEED:
        raise InputError(
            f"`seeds` {seeds}: seeds below {FIRST_TRAINING_SEED} are kept for tuning and reporting; "
            f"give {FIRST_TRAINING_SEED} and up"
        )

    def say(line: str) -> None:
        typer.echo(line, err=True)

    if case in (TURNING, RESIDUAL, RECURRENT, EMPIRICAL) and options["components"] is not None:
        raise InputError(f"`components`: the case {case} fits no mixture; leave it out")
    for name in ("densities", "duration", "seed"):
        if case == TURNING and options[name]:
            why = "draws nothing" if name == "seed" else "takes the demands of its networks"
            raise InputError(f"`{name}`: the case {TURNING} {why}; leave it out")
    if case == TURNING:
        networks = [load_network(name) for name in (options["net"] or ON_NETWORKS).split(",")]
        paths = [train_turning(networks, traffic, options["cache"], options["out"], say)]
    else:
        plan = TrainingPlan(
            *(case, options["components"], traffic, options["seed"]),
            *(options["cache"], options["out"]),
            _densities(options["densities"]),
            options["duration"] or TRAINING_DURATION_S,
        )
        network = load_network(options["net"] or "us101")
        _ = network.main_road  # which the cases are recorded along
        paths = train(plan, network, say)
    if options["json"]:
        typer.echo(json.dumps({"models": [str(path) for path in paths]}))
    else:
        for path in paths:
            typer.echo(f"{path} and {path.with_suffix('.md').name}")
