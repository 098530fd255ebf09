"""Which seeds of traffic serve training, tuning and reporting: no seed serves two purposes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from harness.lab.windows.recording import Scenario, record_all
from harness.truth.frame import TruthSource
from harness.truth.network.network import Network
from harness.truth.sumo.simulation import open_traffic

DENSITIES_VEH_PER_KM_LANE = (8.0, 15.0, 22.0, 29.0, 36.0, 43.0, 50.0, 57.0)
FIRST_TRAINING_SEED = 1000
FIRST_TUNING_SEED = 100
TRAINING_DURATION_S = 200.0
TUNING_DURATION_S = 100.0
REPORTING_DURATION_S = 60.0


def scenarios(
    first_seed: int, count: int, duration_s: float, densities: Sequence[float] = DENSITIES_VEH_PER_KM_LANE
) -> list[Scenario]:
    """Return scenarios of ``count`` seeds, each at every density."""
    seeds = range(first_seed, first_seed + count)
    return [Scenario(density, seed, duration_s) for seed in seeds for density in densities]


def traffic_version(network: Network) -> str:
    """Return the name of a network's present traffic: it changes with the road, the vehicle types and the drivers."""
    return f"{network.name}-{network.fingerprint()}"


def _open_scenario(network: Network, scenario: Scenario) -> TruthSource:
    """Start SUMO for one scenario, with no ego vehicle."""
    return open_traffic(
        network,
        demand=scenario.density_veh_per_km_lane,
        duration_s=scenario.duration_s,
        seed=scenario.seed,
        ego=False,
    )


def record_scenarios(
    network: Network, wanted: Sequence[Scenario], cache: Path | None, say: Callable[[str], None]
) -> list[Path]:
    """Record what is not recorded yet, one line each to ``say``, and return the files.

    They lie in ``cache``, or without it in the usual folder, which differs for other drivers on the same network.
    """
    usual = Path("results") / "cache" / "traffic" / traffic_version(network)
    return record_all(wanted, cache or usual, partial(_open_scenario, network), say)
