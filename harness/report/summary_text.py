"""Sentences that state a run's metrics."""

from collections.abc import Mapping
from typing import Any

from harness.common.numbers import number
from harness.truth.frame import ROAD_OF_RECORDING

Metrics = Mapping[str, Any]

# Shares, in percent, between which 95 % intervals pass for right; hidden vehicles are few and their errors alike.
HONEST_COVERAGE = (
    ("visible", "vehicles that are not hidden", (93.0, 97.0)),
    ("hidden", "hidden vehicles", (90.0, 98.0)),
)
FEWEST_EVENTS, FEWEST_SAMPLES, FEWEST_KM = 5, 100, 0.1
"""Of fewer occlusions or fewer vehicle-steps nothing is said, and on a shorter way nothing per km."""


def setting_sentence(metrics: Metrics) -> str:
    """Return what was tracked by what, and where."""
    run, traffic = metrics["run"], metrics["traffic"]
    tracker = f"The tracker {run['tracker']}" + (f" with the motion model {run['model']}" if run.get("model") else "")
    sensor = f"the sensor {run['sensor']} of one car, the ego"
    text = f"{tracker} follows the traffic of {traffic_source(metrics)}, with {sensor}."
    density, in_range = traffic["density_veh_per_km_lane"], traffic["vehicles_in_range"]
    if in_range is None:
        return text
    share = metrics.get("coverage", {}).get("hidden_percent")
    hidden = f", and {share:.0f} % of them are hidden" if share is not None else ""
    # A recording without lanes has no density.
    road = f"there are {density:.0f} vehicles per km and lane at {number(traffic['mean_speed_mps'], 0)} m/s; "
    return f"{text} On average, {road if density else ''}{in_range:.0f} vehicles are within its range{hidden}."


def traffic_source(metrics: Metrics) -> str:
    """Return the source of the traffic: the network's name, or the recording's file and its network if it has one."""
    net, file = str(metrics["run"]["net"]), metrics.get("recording", {}).get("file")
    if net == ROAD_OF_RECORDING:
        return str(file or "a recording")
    return f"{file} on {net}" if file else net


def summary_sentences(metrics: Metrics) -> list[str]:
    """Return the run's result as a few sentences; what was not measured is not mentioned."""
    return [sentence for part in (_hidden, _occlusions, _trust) if (sentence := part(metrics))]


def _hidden(metrics: Metrics) -> str:
    hidden = metrics["mae"]["hidden"]
    if hidden.get("position_m") is None:
        return "No hidden vehicle was followed."
    share = (metrics.get("hidden_outcomes") or {}).get("tracked_percent")
    kept = f"While vehicles were hidden, their own tracks stayed with them {share:.0f} % of the time. " if share else ""
    interval = hidden.get("position_m_ci95")
    between = f" (95 % interval {interval[0]:.2f} to {interval[1]:.2f} m)" if interval else ""
    return f"{kept}These tracks were {hidden['position_m']:.2f} m off on average{between}."


def _occlusions(metrics: Metrics) -> str:
    occlusion = metrics["occlusion"]
    events, untracked = occlusion["events"], occlusion.get("untracked") or 0
    if not events:
        return "No vehicle was hidden for half a second or longer and detected again."
    fates = {
        "had the same track": occlusion["same_id"],
        "had lost it": occlusion["lost"] - untracked,
        "had no track before": untracked,
        "had their track on another vehicle": occlusion["hijacked"],
        "had their track in another place": occlusion["survived"] - occlusion["same_id"],
    }
    text = (
        f"Vehicles were hidden for half a second or longer and detected again {_times(events)}: "
        + ", ".join(f"{count} {fate}" for fate, count in fates.items() if count)
        + "."
    )
    if events < FEWEST_EVENTS:
        return f"{text} These are too few for a rate (n = {events})."
    short, long = occlusion.get("short"), occlusion.get("long")
    if not short or not long:
        return text
    return (
        f"{text} After at most 3 s, {short['same_id']} of {short['events']} had the same track; after longer, "
        f"{long['same_id']} of {long['events']}."
    )


def _trust(metrics: Metrics) -> str:
    parts = []
    for state, name, (least, most) in HONEST_COVERAGE:
        scores = metrics["calibration"].get(state) or {}
        share = (scores.get("coverage95") or {}).get("lon")
        if share is None:
            continue
        if scores["n"] < FEWEST_SAMPLES:
            parts.append(f"too few samples of {name} (n = {scores['n']})")
            continue
        wrong = "the tracker is too sure" if round(share) < least else "the tracker is too unsure"
        verdict = "about right" if least <= round(share) <= most else wrong
        parts.append(f"{share:.0f} % for {name} ({verdict})")
    return f"The true position was within the tracks' 95 % intervals: {', '.join(parts)}." if parts else ""


def decided(metrics: Metrics) -> Metrics:
    """Return what the ego's driver would have done; nothing where none was asked."""
    decisions: Metrics = metrics.get("decisions") or {}
    return decisions if decisions.get("n") else {}


def decision_sentence(metrics: Metrics) -> str:
    """Return a sentence on missed and phantom brakings; empty where no driver was used."""
    if not (decisions := decided(metrics)):
        return ""
    needed = needed_brakings(decisions)
    missed = (
        f"missed {out_of(str(decisions['missed']), needed)} necessary brakings" if needed else "had no need to brake"
    )
    return (
        f"On {driven(decisions['km'])}, a driver who relied on these tracks {missed}, and had "
        f"{_none(decisions['phantom'], 'phantom braking')}."
    )


def needed_brakings(decisions: Metrics) -> int:
    """Return how many times the driver had to brake; a braking is missed within such a time, or in one cut short."""
    return int(max(decisions["onsets"], decisions["missed"]))


def driven(km: float) -> str:
    """Return a way in words, a short one in metres."""
    return f"{km:.2f} km" if km >= FEWEST_KM else f"{1000.0 * km:.0f} m"


def decision_summary(metrics: Metrics) -> str:
    """Return sentences on the driver's decisions by the tracks; empty where no driver was used."""
    if not (decisions := decided(metrics)):
        return ""
    driver, late = metrics["run"].get("driver", ""), decisions["lateness_s"]
    starts = f" In {_none(decisions['onsets'], 'case')} in which it had to brake, it would have begun"
    return (
        f"{decision_sentence(metrics)}{'' if late is None else f'{starts} {late:.1f} s late on average.'} "
        f"At each step, the driver model {driver} chooses the ego's acceleration once from the truth and once from the "
        "tracks; the ego does not follow it. A braking is missed if, for half a second or longer, it is -2 m/s² or "
        "less from the truth and more than -1 m/s² from the tracks; phantom is the reverse. The two accelerations "
        f"differ by {decisions['accel_difference_mps2']:.2f} m/s² on average."
    )


def _none(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def out_of(part: str, total: float | None) -> str:
    """Return a count or share with the number that it is out of, if that is known."""
    return f"{part} of {total:.0f}" if total else part
