"""What a run's metrics say, in sentences and in headline numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import binomtest

from harness.truth.frame import ROAD_OF_RECORDING

Metrics = Mapping[str, Any]

# Shares, in percent, between which 95 % intervals pass for honest; hidden vehicles are few and their errors alike.
HONEST_COVERAGE = (
    ("visible", "vehicles in view", (93.0, 97.0)),
    ("hidden", "hidden ones", (90.0, 98.0)),
)
WHY_MISSED = {
    "none": "for a vehicle that no track ever held",
    "lost": "whose track was given up",
    "displaced": "whose track stood or moved otherwise than the vehicle",
    "hijacked": "whose track sat on another vehicle",
}


@dataclass(frozen=True)
class Headline:
    """One number that stands out on the page.

    Attributes:
        label: What it is.
        value: The number with its unit.
        interval: Its 95 % interval, or what stands in its place.
        note: One line on how to read it.
    """

    label: str
    value: str
    interval: str
    note: str


def summary_sentences(metrics: Metrics) -> list[str]:
    """Return the run's result as a few sentences; what was not measured is not mentioned."""
    parts = (_setting, _in_plain_view, _in_sight, _hidden_cost, _hidden, _occlusions, _decisions, _trust, _speed)
    return [sentence for part in parts if (sentence := part(metrics))]


def traffic_source(metrics: Metrics) -> str:
    """Return where the traffic came from: the network's name, or the recording's file and the network if it has one."""
    net, file = str(metrics["run"]["net"]), metrics.get("recording", {}).get("file")
    if net == ROAD_OF_RECORDING:
        return str(file or "a recording")
    return f"{file} on {net}" if file else net


def headlines(metrics: Metrics) -> list[Headline]:
    """Return the numbers that stand at the top of the page."""
    mae, occlusion, hidden = metrics["mae"], metrics["occlusion"], metrics.get("hidden") or {}
    events = occlusion["events"] or 0
    kept = occlusion["same_id"] or 0
    coverage = metrics["calibration"]["coverage95"]["lon"]
    step_ms = metrics["timing"]["tracker_ms"]
    return [
        Headline(
            "Same track after hiding",
            f"{kept} of {events}" if events else "no case",
            _interval_of_share(kept, events) if events else "",
            "hidden vehicles that came back on their own track",
        ),
        Headline(
            "Hidden cost",
            number(hidden.get("hidden_cost_m"), 2, " m"),
            _between(hidden.get("hidden_cost_m_ci95"), " m"),
            "how far off hidden vehicles are held to be, over all once seen, 10 m where nobody follows",
        ),
        Headline(
            "False hidden tracks",
            number(hidden.get("false_hidden_tracks_per_scan"), 2),
            "a scan",
            "tracks out of sight that follow nobody: the price of a low hidden cost",
        ),
        _error_headline("Error, hidden", mae["hidden"]),
        _error_headline("Error, visible", mae["visible"]),
        Headline("HOTA, in sight", number(metrics["mot"]["hota"], 1, " %"), "one run: no interval", "100 % is perfect"),
        Headline(
            "Identity switches",
            number(metrics["mot"]["id_switches"], 0),
            f"{number(metrics['mot'].get('id_switches_per_vehicle_minute'), 2)} per vehicle and minute",
            "vehicles in sight that changed tracks",
        ),
        Headline(
            "Truth in 95 % interval", number(coverage, 0, " %"), "95 % would be honest", "longitudinal, all vehicles"
        ),
        Headline(
            "Tracker step",
            number(step_ms["p50"], 0, " ms"),
            f"99 % within {number(step_ms['p99'], 0, ' ms')}",
            "median, on the machine named below",
        ),
    ]


def _interval_of_share(successes: int, trials: int) -> str:
    """Return the 95 % interval of a share (Wilson 1927)."""
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return f"{100 * interval.low:.0f} to {100 * interval.high:.0f} %"


def _setting(metrics: Metrics) -> str:
    run, traffic = metrics["run"], metrics["traffic"]
    tracker = f"tracker {run['tracker']}" + (f" with motion model {run['model']}" if run.get("model") else "")
    text = (
        f"{tracker[0].upper()}{tracker[1:]} followed the traffic of {traffic_source(metrics)} for "
        f"{run['duration_s']:g} s, seen by the {run['sensor']} of a car in it"
    )
    density, in_range = traffic["density_veh_per_km_lane"], traffic["vehicles_in_range"]
    if density is None or in_range is None:
        return text + "."
    share = metrics.get("coverage", {}).get("hidden_percent")
    hidden = f", of which {share:.0f} % were hidden behind others" if share is not None else ""
    return (
        f"{text}: {density:.0f} vehicles per km and lane at {number(traffic['mean_speed_mps'], 0)} m/s, "
        f"{in_range:.0f} of them within the sensor's range at a time{hidden}."
    )


def _in_plain_view(metrics: Metrics) -> str:
    plain = metrics.get("in_plain_view") or {}
    if plain.get("recall") is None:
        return ""
    never, dropped = plain["never_reported"], plain["dropped"]
    worst = "" if plain["worst_tenth"] is None else f" ({plain['worst_tenth']:.0f} % for the worst tenth of them)"
    had = f"{_plural(never, 'vehicle')} never had one" if never else "no vehicle was without one all the time"
    lost = f"{_plural(dropped, 'track')} {'was' if dropped == 1 else 'were'} dropped" if dropped else "none was dropped"
    return f"Vehicles in plain view within 60 m had a track {plain['recall']:.1f} % of the time{worst}; {had}, {lost}."


def _in_sight(metrics: Metrics) -> str:
    visible, mot = metrics["mae"]["visible"], metrics["mot"]
    if visible.get("position_m") is None or mot["hota"] is None:
        return ""
    return (
        f"Vehicles in plain view were placed {_with_interval(visible, 'position_m', ' m')} from where they were, on "
        f"average, and in sight tracks changed vehicles {_times(mot['id_switches'])} (HOTA {mot['hota']:.1f} %)."
    )


def _hidden_cost(metrics: Metrics) -> str:
    hidden = metrics.get("hidden") or {}
    if hidden.get("hidden_cost_m") is None:
        return ""
    false = number(hidden["false_hidden_tracks_per_scan"], 2)
    return (
        f"Vehicles hidden after they were seen were held to be {_with_interval(hidden, 'hidden_cost_m', ' m')} from "
        f"where they were, 10 m counted where no track followed, at the price of {false} false hidden tracks a scan."
    )


def _hidden(metrics: Metrics) -> str:
    hidden = metrics["mae"]["hidden"]
    if hidden.get("position_m") is None:
        return "No hidden vehicle was followed."
    outcomes = metrics.get("hidden_outcomes") or {}
    share = outcomes.get("tracked_percent")
    kept = f"While vehicles were hidden, their tracks stayed with them {share:.0f} % of the time; " if share else ""
    text = f"{kept}the mean error was then {_with_interval(hidden, 'position_m', ' m')}."
    return text[0].upper() + text[1:]


def _occlusions(metrics: Metrics) -> str:
    occlusion = metrics["occlusion"]
    events = occlusion["events"]
    if not events:
        return "No tracked vehicle was hidden for half a second or more and seen again."
    text = (
        f"Tracked vehicles went out of sight and came back {_times(events)}: {_count(occlusion['same_id'])} on the "
        f"same track, {_count(occlusion['lost'])} had lost it, {_count(occlusion['hijacked'])} found it on another "
        f"vehicle and {_count(occlusion['survived'] - occlusion['same_id'])} on nothing"
    )
    short, long = occlusion.get("short"), occlusion.get("long")
    if not short or not long:
        return text + "."
    return (
        f"{text}. Of {short['events']} that were gone for at most 3 s {short['same_id']} kept their track, of "
        f"{long['events']} gone for longer {long['same_id']}."
    )


def _decided(metrics: Metrics) -> Metrics:
    """Return what the ego's driver would have done; nothing where none was asked."""
    decisions: Metrics = metrics.get("decisions") or {}
    return decisions if decisions.get("n") else {}


def _decisions(metrics: Metrics) -> str:
    decisions = _decided(metrics)
    if not decisions:
        return ""
    missed, phantom = _times(decisions["missed"]), _times(decisions["phantom"])
    return (
        f"By these tracks a driver in the ego's place would have failed to brake {missed} where it had to, and braked "
        f"for nothing {phantom}, on {decisions['km']:.2f} km."
    )


def decision_summary(metrics: Metrics) -> str:
    """Return what the ego's driver would have done by the tracks, in words; empty where none was asked."""
    decisions = _decided(metrics)
    if not decisions:
        return ""
    driver = metrics["run"].get("driver", "")
    fates = [f"{count} {WHY_MISSED[fate]}" for fate, count in decisions["missed_by"].items() if count]
    missed = _plural(decisions["missed"], "braking") + (f" ({', '.join(fates)})" if fates else "")
    ghosts = decisions["phantom_by"]["ghost"]
    phantom = _plural(decisions["phantom"], "time") + (f", {ghosts} of them for a track of nobody" if ghosts else "")
    late = decisions["lateness_s"]
    of = f"Of {_plural(decisions['onsets'], 'time')} that it had to brake it would have begun"
    lateness = "" if late is None else f" {of} {late:.1f} s late, on average."
    return (
        f"A driver ({driver}) in the ego's place was asked at each step what it would do, by the truth and by the "
        f"tracks; the ego itself drove as it did. On {decisions['km']:.2f} km it would have missed {missed}, and "
        f"braked for nothing {phantom}: for half a second or more one called for -2 m/s² or less, the other for more "
        "than -1 m/s². What they called for differed by "
        f"{decisions['accel_difference_mps2']:.2f} m/s² on average.{lateness}"
    )


def _plural(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _trust(metrics: Metrics) -> str:
    parts = []
    for state, name, (least, most) in HONEST_COVERAGE:
        scores = metrics["calibration"].get(state)
        share = scores["coverage95"]["lon"] if scores else None
        if share is None:
            continue
        verdict = "about right"
        if share < least:
            verdict = "too small, it is surer than it should be"
        elif share > most:
            verdict = "too large, it knows more than it says"
        parts.append(f"in {share:.0f} % of cases for {name} ({verdict})")
    return f"The tracker's 95 % intervals held the true position {' and '.join(parts)}." if parts else ""


def _speed(metrics: Metrics) -> str:
    timing = metrics["timing"]
    median, factor = timing["tracker_ms"]["p50"], timing["realtime_factor"]
    if median is None or factor is None:
        return ""
    pace = f"{factor:.1f} times as fast as" if factor >= 1.0 else f"{1.0 / factor:.1f} times slower than"
    return f"A tracker step took {median:.0f} ms; traffic, sensor and tracker together ran {pace} real time."


def _error_headline(label: str, row: Mapping[str, Any]) -> Headline:
    share = row.get("followed_percent")
    note = "mean distance of vehicle and track while followed" + (f", {share:.0f} % of the time" if share else "")
    return Headline(label, number(row.get("position_m"), 2, " m"), _between(row.get("position_m_ci95"), " m"), note)


def _between(interval: Sequence[float] | None, unit: str) -> str:
    return f"{interval[0]:.2f} to {interval[1]:.2f}{unit}" if interval else ""


def _with_interval(row: Mapping[str, Any], key: str, unit: str) -> str:
    interval = row.get(f"{key}_ci95")
    between = f" (95 % interval {interval[0]:.2f} to {interval[1]:.2f}{unit})" if interval else ""
    return f"{row[key]:.2f}{unit}{between}"


def _count(cases: int) -> str:
    return str(cases) if cases else "none"


def _times(count: int) -> str:
    return {0: "never", 1: "once", 2: "twice"}.get(count, f"{count} times")


def number(value: float | None, decimals: int, unit: str = "") -> str:
    """Return a number with its unit, or a dash for none."""
    return "-" if value is None else f"{value:.{decimals}f}{unit}"
