"""The command that repeats one run of a grid."""

from __future__ import annotations

import json
import shlex

from harness.config.layers import leaves
from harness.config.model import DEFAULT_TRACKER, RunConfig, TrackerConfig
from harness.config.options import keys_of_options

ALWAYS = ("traffic.density", "traffic.demand", "seed")


def command_of(config: RunConfig) -> str:
    """Return the command line that makes this very run again; what is not said in it is the default."""
    default = dict(leaves(RunConfig(tracker=TrackerConfig(name=config.tracker.name)).as_table()))
    words = ["python", "-m", "harness", "run"]
    for key, value in leaves(config.as_table()):
        if key in ALWAYS or value != (DEFAULT_TRACKER if key == "tracker.name" else default.get(key)):
            words += _said(key, value)
    return shlex.join(words)


def _said(key: str, value: object) -> list[str]:
    option_of = {key: name for name, key in keys_of_options().items()}
    if key in option_of:
        return [f"--{option_of[key].replace('_', '-')}", str(value)]
    # A text stands for itself that TOML would not read as a number, a truth value or a list.
    plain = isinstance(value, str) and value not in ("true", "false", "nan", "inf") and value.replace("_", "").isalpha()
    return ["--set", f"{key}={value if plain else json.dumps(value)}"]
