"""The tables that commands print."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from harness.common.markdown import Terminal
from harness.common.numbers import number
from harness.report.summary_text import decision_sentence, out_of, traffic_source
from harness.scoring.metrics.decisions import KM
from harness.scoring.metrics.quantity import Quantity
from harness.scoring.metrics.registry import view
from harness.truth.network.network import NetworkDescription

VISIBILITY_ROWS = (("visible", "visible"), ("partial", "partly hidden"), ("hidden", "hidden"), ("all", "all"))
POSITION_COLUMNS = (("lon_m", "lon, m"), ("lat_m", "lat, m"))
MAE_COLUMNS = (*POSITION_COLUMNS, ("speed_mps", "speed, m/s"), ("lat_speed_mps", "lat speed, m/s"))
MOT = "mot."
BESIDE = ("in_plain_view.recall", "in_plain_view.worst_tenth")
"""What stands beside the multi-object scores of the vehicles in sight."""
REPORTED = (
    *("hidden", "mot", "gospa_remembered", *BESIDE, "in_plain_view.median_first_report_s"),
    *("in_plain_view.p90_first_report_s", "in_plain_view.stopped_recall", "calibration", "existence_calibration"),
    *("motion.visible.jerk_mps3", "motion.hidden.jerk_mps3", "motion.visible.jump_m", "motion.hidden.jump_m"),
    *("manoeuvre", "decisions", "hidden_by", "unseen_turns", "pseudo_occlusion", "never_seen.log_skill_percent"),
)
PRINTED = ("hidden", "pseudo_occlusion")
"""What the terminal shows of these; the page shows all."""
IN_WORDS: Mapping[str, Mapping[str, Any]] = {
    "mot.id_switches": {"label": "identity switches in sight", "heading": "identity switches", "decimals": 0},
    "mot.missed": {"heading": "vehicle-steps without a track"},
    "mot.false_tracks": {"heading": "track-steps without a vehicle"},
    "calibration.anees.visible": {"label": "ANEES of tracks on vehicles that are not hidden"},
    "calibration.anees.hidden": {"label": "ANEES of tracks on hidden vehicles"},
}
SCORE_HEADINGS = ("score", "value", "better", "samples")
OWN_METRICS = "Your own metrics"
OUT_OF = {"missed": "truth_n", "false_tracks": "tracks_n"}
"""What counts are out of, beside them in ``metrics.json``."""


def mot_columns() -> list[Quantity]:
    """Return the columns of the table of multi-object scores, as those in sight declare them."""
    reported = {quantity.key: quantity for quantity in view(REPORTED, IN_WORDS)}
    beside = [reported[key] for key in BESIDE]
    return [*(quantity for key, quantity in reported.items() if key.startswith(MOT)), *beside]


def mot_value(metrics: Mapping[str, Any], vehicles: str, column: Quantity) -> str:
    """Return a score of the vehicles ``mot`` or ``mot_all``, counts with what they are out of; a dash for none."""
    if column.key in BESIDE:
        return number(column.of(metrics) if vehicles == "mot" else None, column.decimals)
    scores, key = metrics[vehicles], column.key.removeprefix(MOT)
    return out_of(number(scores.get(key), column.decimals), scores.get(OUT_OF.get(key)))


def other_scores(metrics: Mapping[str, Any], listed: Sequence[str] = REPORTED) -> list[list[str]]:
    """Return name, value, better direction and number of samples of the other scores of a list."""
    apart = {quantity.key for quantity in (*mot_columns(), *view(()))}
    return _score_rows(metrics, [quantity for quantity in view(listed, IN_WORDS) if quantity.key not in apart])


def own_scores(metrics: Mapping[str, Any]) -> list[list[str]]:
    """Return the same of the metrics that the user has written."""
    return _score_rows(metrics, view(()))


def _score_rows(metrics: Mapping[str, Any], quantities: Sequence[Quantity]) -> list[list[str]]:
    return [
        [quantity.label, number(value, quantity.decimals), quantity.better, _samples(quantity, metrics)]
        for quantity, value in ((quantity, quantity.of(metrics)) for quantity in quantities)
        if value is not None or not quantity.is_of_some_runs
    ]


def _samples(quantity: Quantity, metrics: Mapping[str, Any]) -> str:
    count = replace(quantity, key=quantity.weight).of(metrics) if quantity.weight else None
    return number(count, 2, " km") if quantity.weight == KM else number(count, 0)


def print_summary(metrics: Mapping[str, Any], folder: Path, *, is_log: bool = False) -> None:
    """Print the main figures of a run's ``metrics.json`` on stderr, and where its folder is; of a log no times."""
    run = metrics["run"]
    words = [traffic_source(metrics), *(str(run[key]) for key in ("tracker", "model", "update") if run.get(key))]
    title = " · ".join(words)
    Terminal(stderr=True, highlight=False).print(
        Group(
            Text(f"\n{title} · seed {run['seed']}", style="bold"),
            _error_table(metrics["mae"]),
            _mot_table(metrics),
            _table("Hidden vehicles", SCORE_HEADINGS, other_scores(metrics, PRINTED)),
            *([_table(OWN_METRICS, SCORE_HEADINGS, own)] if (own := own_scores(metrics)) else []),
            _lines(metrics, is_log),
            Text(f"Results: {folder}", style="bold"),
            Text(f"Open in a browser: {folder / 'report.html'}"),
        )
    )


def print_networks(networks: Sequence[NetworkDescription]) -> None:
    """Print the networks and their demands on stdout, one line each."""
    table = Table(box=box.SIMPLE)
    for heading in ("--net", "--demand", "what it is"):
        table.add_column(heading, no_wrap=heading.startswith("--"))
    for network in networks:
        size = f"{network.section_length_m:.0f} m scored, {network.lanes} main lanes"
        if not network.lanes:
            size = f"{network.section_length_m / 1000.0:.1f} km of lanes"
        table.add_row(network.name, "", f"{network.description} ({size})", style="bold")
        for name, description in network.demands:
            table.add_row("", name, description)
    Console(highlight=False).print(table)


def _table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(title=title, box=box.SIMPLE, title_justify="left", padding=(0, 1, 0, 0))
    table.add_column(headings[0])
    for heading in headings[1:]:
        table.add_column(heading, justify="left" if heading == "better" else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def followed(row: Mapping[str, Any]) -> str:
    """Return the share of vehicle-steps that the errors of a row of ``mae`` are over, and their number."""
    return out_of(number(row.get("followed_percent"), 0, " %"), row.get("of_n"))


def _error_table(mae: Mapping[str, Any]) -> Table:
    title = "Mean absolute error of followed vehicles, along (lon) and across (lat) the road"
    named = [(name, mae[key]) for key, name in VISIBILITY_ROWS]
    rows = [[name, *(number(row.get(key), 2) for key, _ in MAE_COLUMNS), followed(row)] for name, row in named]
    return _table(title, ["vehicles", *(heading for _, heading in MAE_COLUMNS), "followed"], rows)


def _mot_table(metrics: Mapping[str, Any]) -> Table:
    columns = [column for column in mot_columns() if column.key not in BESIDE]
    rows = [[column.heading, *(mot_value(metrics, of, column) for of in ("mot", "mot_all"))] for column in columns]
    return _table("Tracks against truth", ("score", "in sight", "detected in last 10 s"), rows)


def _lines(metrics: Mapping[str, Any], is_log: bool) -> Text:
    traffic, timing = metrics["traffic"], metrics["timing"]
    road = (
        f"{number(traffic['density_veh_per_km_lane'], 1)} vehicles per km and lane, "
        f"{number(traffic['flow_veh_per_h'], 0)} per hour, at {number(traffic['mean_speed_mps'], 1)} m/s; "
    )
    in_range = number(traffic["vehicles_in_range"], 1)
    road = f"Traffic: {road if traffic['flow_veh_per_h'] else ''}{in_range} vehicles within the sensor's range"
    speed = (
        f"Time: {number(timing['total_s'], 1)} s. The {timing['steps']} steps ran at "
        f"{number(timing['realtime_factor'], 1)} times real time; the tracker took "
        f"{number(timing['tracker_ms']['p50'], 1)} ms a step (median)"
    )
    plain, driver = _plain_view(metrics.get("in_plain_view") or {}), decision_sentence(metrics)
    events, windows = _occlusions(metrics["occlusion"]), metrics.get("pseudo_occlusion") or {}
    if windows and not windows["all"]["windows"]:
        events += "\nNo vehicle moved in view long enough to be hidden on purpose"
    lines = (plain, events, driver, "What scores mean: docs/explanation/scores.md", road, "" if is_log else speed)
    return Text("\n".join(line for line in lines if line))


def _occlusions(counts: Mapping[str, Any]) -> str:
    if not counts["events"]:
        return "No vehicle came back into view after an occlusion"
    elsewhere = (counts["survived"] or 0) - (counts["same_id"] or 0)
    told = (("events", "occlusion"), ("same_id", "vehicle"))
    events, vehicles = (f"{number(counts[key], 0)} {word}{'' if counts[key] == 1 else 's'}" for key, word in told)
    return (
        f"After {events}: {vehicles} had the same track, {number(counts['lost'], 0)} none, "
        f"{number(counts['hijacked'], 0)} a track on another vehicle, {elsewhere:.0f} a track elsewhere"
    )


def _plain_view(scores: Mapping[str, Any]) -> str:
    """Return a line on the vehicles in plain view; empty for a run that was scored before there was such a score."""
    if scores.get("recall") is None:
        return ""
    return (
        f"In plain view, vehicles had a track {number(scores['recall'], 1, ' %')} of the time (worst tenth "
        f"{number(scores['worst_tenth'], 1, ' %')}); {out_of(str(scores['never_reported']), scores.get('vehicles_n'))} "
        f"vehicles never got one; tracks lost: {scores['dropped']}"
    )
