"""What went wrong in a run, the worst first: a sentence each, and where the replay shows it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from harness.running.finished import RecordedRun
from harness.scoring.metrics.in_plain_view import DROPPED, NAME
from harness.storage.tables import floats

WORST = 5
WORST_WITHHELD = 4
BEFORE_S, AFTERWARDS_S = 1.0, 0.5
UNSEEN_S = 0.5
TWO_WHEELER_M, LORRY_M = 3.0, 7.5
"""A vehicle up to the first length is a two-wheeler, one from the second on a lorry."""
SEVERITY = {"lost": 0, "hijacked": 0, "survived": 1, "same_id": 2}
ENDS = {
    "lost": "its track {track} was deleted",
    "hijacked": "its track {track} was on another vehicle afterwards",
    "survived": "its track {track} continued, but not on this vehicle",
    "same_id": "track {track} followed it again afterwards",
}
WHY = {
    "missed": {
        "none": "it never had a track",
        "lost": "its track was deleted",
        "displaced": "{track} follows it, but has another position or speed",
        "hijacked": "its {track} is on another vehicle",
    },
    "phantom": {
        "ghost": "{track} follows no vehicle",
        "displaced": "{track} follows {vehicle}, but has another position",
        "hijacked": "{track} went over from another vehicle to {vehicle}",
    },
}


@dataclass(frozen=True)
class Failure:
    """What happened, in a sentence, and the vehicle that the replay shows from one time to another."""

    sentence: str
    vehicle_id: str
    time_s: float
    until_s: float

    @property
    def end_s(self) -> float:
        """Return when the failure ends, seconds: ``until_s`` without the time that is shown afterwards."""
        return self.until_s - AFTERWARDS_S


@dataclass(frozen=True)
class Failures:
    """The failures of one kind, worst first: those that are shown at once, and the others."""

    worst: list[Failure]
    others: list[Failure]


def failures_of(run: RecordedRun) -> Failures:
    """Return the vehicles in plain view without a track, then the occlusions.

    The others are all further ones of the former, and the occlusions after which a track was not on its vehicle.
    """
    begin_s = run.truth.drop_duplicates("step").set_index("step")["time_s"]
    occlusions = [
        Failure(occlusion_sentence(event), event["vehicle_id"], start_s, start_s + event["duration_s"] + AFTERWARDS_S)
        for event in ranked_events(run.events, run.errors)
        for start_s in [float(begin_s[event["from_step"]])]
    ]
    failed, withheld = int((run.events["outcome"] != "same_id").sum()), list(withheld_vehicles(run))
    return Failures(
        [*withheld[:WORST_WITHHELD], *occlusions[:WORST]], [*withheld[WORST_WITHHELD:], *occlusions[WORST:failed]]
    )


def withheld_vehicles(run: RecordedRun) -> Iterator[Failure]:
    """Yield the vehicles in plain view that were never reported or lost their track, worst first.

    None of a run that was scored before there was such a list; of a long run those count alone that the read part of
    its tables shows.
    """
    end_s = float(run.truth["time_s"].max()) if len(run.truth) else -np.inf
    names = run.truth["vehicle_id"].to_numpy(dtype=object)
    for entry in (run.metrics.get(NAME) or {}).get("vehicles") or []:
        own = names == entry["id"]
        if entry["to_s"] <= end_s + 1e-6 and own.any():
            sentence = withheld_sentence(entry, float(floats(run.truth, "length_m")[own][0]))
            yield Failure(sentence, entry["id"], entry["from_s"], entry["to_s"] + AFTERWARDS_S)


def withheld_sentence(entry: Mapping[str, Any], length_m: float) -> str:
    """Return a sentence on a vehicle in plain view without a track; its length is nan where it is not known."""
    kind = "two-wheeler" if length_m <= TWO_WHEELER_M else "lorry" if length_m >= LORRY_M else "car"
    before = "had a track before that" if entry["kind"] == DROPPED else "never had a track in plain view"
    return (
        f"A {kind} in plain view at {entry['closest_m']:.0f} m had no track for {entry['without_track_s']:.1f} s; "
        f"it was detected in {entry['detected_percent']:.0f} % of these scans. It is {entry['id']}, and {before}."
    )


def ranked_events(events: pd.DataFrame, errors: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the occlusions, worst first: lost and hijacked tracks first, then the largest error, then the longest.

    Each has ``largest_error_m`` beside its columns: the largest distance between the vehicle and the track that held it
    while it was hidden; nan if none was measured.
    """
    distance = np.hypot(floats(errors, "lon_error_m"), floats(errors, "lat_error_m"))
    by_vehicle = errors.groupby("vehicle_id", sort=False).indices
    step, track = errors["step"].to_numpy(), errors["track_id"].to_numpy()
    found = []
    for event in events.astype({"vehicle_id": object, "outcome": object}).to_dict("records"):
        at = by_vehicle.get(event["vehicle_id"], np.zeros(0, dtype=np.int64))
        during = at[(step[at] > event["from_step"]) & (step[at] < event["to_step"]) & (track[at] == event["track_id"])]
        off = distance[during][np.isfinite(distance[during])]
        known = {str(name): value for name, value in event.items()}
        found.append(known | {"largest_error_m": float(off.max()) if len(off) else np.nan})
    found.sort(
        key=lambda each: (SEVERITY[each["outcome"]], -np.nan_to_num(each["largest_error_m"]), -each["duration_s"])
    )
    return found


def occlusion_sentence(event: Mapping[str, Any]) -> str:
    """Return a sentence on what became of a hidden vehicle's track."""
    track, off_m = event["track_id"], event["largest_error_m"]
    untracked = event["outcome"] == "lost" and track < 0
    end = "it had no track before" if untracked else ENDS[event["outcome"]].format(track=track)
    error = f"; while hidden, it was up to {off_m:.1f} m off" if np.isfinite(off_m) else ""
    return f"{event['vehicle_id']}, hidden for {event['duration_s']:.1f} s: {end}{error}."


def brakings_of(run: RecordedRun) -> Failures:
    """Return the missed and phantom brakings, first those whose largest difference lasts longest."""
    if run.brakings is None:
        return Failures([], [])
    brakings = run.brakings.astype(dict.fromkeys(("kind", "vehicle_id", "visibility", "fate"), object))
    weight = (brakings["truth_mps2"] - brakings["tracks_mps2"]).abs() * brakings["duration_s"]
    times = run.truth.drop_duplicates("step").set_index("step")["time_s"]
    egos = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)].drop_duplicates("step").set_index("step")["vehicle_id"]
    found = [
        Failure(
            braking_sentence(braking),
            braking["vehicle_id"] or str(egos[braking["step"]]),
            max(float(times[braking["from_step"]]) - BEFORE_S, 0.0),
            float(times[braking["to_step"]]) + AFTERWARDS_S,
        )
        for braking in brakings.loc[(-weight).sort_values(kind="stable").index].to_dict("records")
    ]
    return Failures(found[:WORST], found[WORST:])


def braking_sentence(braking: Mapping[Any, Any]) -> str:
    """Return a sentence on a row of ``brakings.parquet``: what is demanded, who is to blame and why."""
    kind, vehicle = braking["kind"], braking["vehicle_id"]
    track = f"track {braking['track_id']}" if braking["track_id"] >= 0 else "its track"
    why = WHY[kind][braking["fate"]].format(track=track, vehicle=vehicle)
    demands = (
        f"{braking['truth_mps2']:.1f} m/s² by the truth and {braking['tracks_mps2']:.1f} m/s² by the tracks, "
        f"for {braking['duration_s']:.1f} s"
    )
    sight = _sight(braking["visibility"], braking["unseen_s"])
    if kind == "missed":
        return f"Missed braking for {vehicle or 'a vehicle'}, {sight}: {demands}; {why}."
    return f"Phantom braking: {demands}; {why}{f', {vehicle} being {sight}' if vehicle else ''}."


def _sight(visibility: str, unseen_s: float) -> str:
    """Return a phrase on how well the sensor saw a vehicle."""
    if not np.isfinite(unseen_s):
        return "never detected"
    if unseen_s > UNSEEN_S:
        return f"not detected for {unseen_s:.1f} s"
    return {"visible": "visible", "partial": "partly hidden"}.get(visibility, "just hidden")
