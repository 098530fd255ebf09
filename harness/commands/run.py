"""``run``: simulate, sense, track and score once."""

from harness.config import options as shared
from harness.config.options import RunOptions


class Options(RunOptions, total=False):
    """The options of ``run``."""

    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Simulate traffic and a sensor, run a tracker on the detections, and score its tracks.

    Write a run folder: config.toml, manifest.json, truth, detections, tracks
    and errors as parquet, metrics.json, figures, and report.html, the page of
    results. Later settings override earlier ones: defaults, --config, options,
    --set.

    Examples:
      python -m harness run --net us101
      python -m harness run --density 45 --model cam --seed 3 --out results/cam
      python -m harness run --replay results/cam --model cvm --json
      python -m harness run --replay pandaset
      python -m harness run --replay us101.csv --ego each --duration 120
      python -m harness run --replay kitti --format kitti-tracking
      python -m harness run --config config.toml --set sensor.range_m=80
      python -m harness run --set tracker.options.joint.association.gate_std=4
    """
    from harness.commands.actions.run_once import run_once  # noqa: PLC0415

    run_once(options)
