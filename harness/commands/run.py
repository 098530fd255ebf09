"""``run``: simulate, sense, track and score once."""

from __future__ import annotations

import os

import typer

from harness.commands.from_options import typed
from harness.common.streams import streams_and_depth_kept
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
    from harness.api import make_run  # noqa: PLC0415

    as_json, quiet = options.pop("json"), options.pop("quiet")
    with streams_and_depth_kept():
        os.dup2(2, 1)  # what libraries, SUMO's C++ among them, print on stdout goes to stderr
        finished = make_run(options, typed(), quiet)
    if not quiet:
        from harness.report.summary import print_summary  # noqa: PLC0415

        print_summary(finished.metrics, finished.folder)
    if as_json:
        from harness.common.numbers import as_json as text_of  # noqa: PLC0415

        typer.echo(text_of(finished.metrics), nl=False)
