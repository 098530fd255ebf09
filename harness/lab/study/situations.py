"""The study by situation: how far off each model is after some seconds unseen, in simulated or recorded traffic."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.common.markdown import PagePart, markdown_page, markdown_table
from harness.lab.fidelity.samples import whole_recording
from harness.lab.fit.card import regimes_of
from harness.lab.study.study import StudyPlan, model_of, score_row
from harness.lab.study.study_text import error_cell, setting_line
from harness.lab.windows import recording
from harness.lab.windows.car_following import following_windows
from harness.lab.windows.cases import Cases, following_cases, lane_change_cases
from harness.lab.windows.changing import lane_change_windows
from harness.lab.windows.filtering import HORIZONS_S, follow, score
from harness.lab.windows.recording import Recording
from harness.truth.frame import STEP_S
from harness.truth.network.network import Network
from mmpf.map.road import Road
from mmpf.numerics.arrays import taken

SITUATIONS = "situations"
CHANGING = "changing lanes"
SHORT_STEPS = 51
"""States of a window of recorded traffic: 5 s, since vehicles on record drive on for less than simulated ones."""
RECORDED = ("commonroad/*.xml", "ngsim/*.csv")
"""Where files of recorded traffic lie in their folder."""
ABOUT = (
    "Nothing is measured after the start. Mean absolute error of the position along the road, m, with its 95 % "
    "interval over recordings; then the share of cases in which the particles' 95 % interval contains the truth."
)
MODELS = ("residual", "recurrent", "gmm", "empirical", "idm-adaptive", "cvm")

Row = Mapping[str, Any]
Part = tuple[Recording, Road]


def situation_rows(
    plan: StudyPlan, parts: Sequence[Part], steps: int, progress: Callable[[], None]
) -> list[dict[str, Any]]:
    """Return a row for each situation, model and horizon; ``progress`` is called after each situation and model.

    Windows have so many states, ``steps``. Nothing is measured after the true state at the start. Around a lane change
    a model does not know that it comes.

    Raises:
        InputError: The recordings have no situation that lasts so long, or a model is not read from a file.
    """
    rows = []
    for situation, cases in situations_of(plan, parts, steps).items():
        for name in tuple(plan.models) or MODELS:
            model = model_of(plan, name, keeps_lane=situation != CHANGING)
            scores = score(follow(model, cases, plan.particles, np.random.default_rng([plan.seed, 2])), cases)
            ends = {h: round(h / STEP_S) - 1 for h in HORIZONS_S if round(h / STEP_S) < cases.steps}
            head = {"study": SITUATIONS, "situation": situation, "model": name}
            rows += [{**head, **score_row(scores, end, horizon)} for horizon, end in ends.items()]
            progress()
    if not rows:
        raise InputError("`case` situations: no two vehicles drive on for long enough; give more seeds or recordings")
    return rows


def simulated_parts(plan: StudyPlan, network: Network, say: Callable[[str], None]) -> list[Part]:
    """Return a plan's traffic, recorded where it is not yet."""
    paths = recording.record_traffic(network, plan.traffic, recording.REPORTING_DURATION_S, plan.cache, say)
    return [(part, network.road) for part in recording.load_all(paths)]


def recorded_parts(folder: Path) -> list[Part]:
    """Return the recorded traffic of real roads in a folder."""
    files = [path for pattern in RECORDED for path in sorted(folder.glob(pattern))]
    if not files:
        raise InputError(f"`real_data`: {folder} has no recorded traffic ({', '.join(RECORDED)}); name another folder")
    traffic = [whole_recording(path) for path in files]
    return [(recording.recording_of(part), part.road) for part in traffic]


def situations_of(plan: StudyPlan, parts: Sequence[Part], steps: int) -> dict[str, Cases]:
    """Return cases by situation, at most ``plan.cases`` of each, without situations of fewer than two."""
    windows = recording.joined_apart([following_windows(*part, steps) for part in parts], "vehicle", "traffic")
    changes = recording.joined_apart([lane_change_windows(*part) for part in parts], "traffic")
    rng = np.random.default_rng([plan.seed, 0])
    situations = {
        name: following_cases(taken(windows, chosen), plan.cases, rng, led_only=False)
        for name, chosen in regimes_of(windows).items()
    }
    situations[CHANGING] = lane_change_cases(changes, plan.cases, rng)
    return {name: cases for name, cases in situations.items() if cases.count > 1}


def as_markdown(rows: Sequence[Row], setting: Mapping[str, Any]) -> str:
    """Return a table for each situation: the error and how often the 95 % interval holds the truth, by horizon."""
    parts: list[PagePart] = ["# Study: situations", ABOUT]
    for situation in dict.fromkeys(row["situation"] for row in rows):
        some = [row for row in rows if row["situation"] == situation]
        horizons = dict.fromkeys(row["horizon_s"] for row in some)
        cells: dict[str, list[str]] = {}
        for row in some:
            cell = f"{error_cell(row, 'lon_m')}; {100 * row['coverage95_lon_m']:.0f} %"
            cells.setdefault(row["model"], []).append(cell)
        heads = ["model", *(f"{horizon:g} s" for horizon in horizons)]
        table = markdown_table(heads, [[model, *line] for model, line in cells.items()])
        parts += [f"## {situation.capitalize()}, {some[0]['n']} cases", table]
    return markdown_page([*parts, "## Setting", setting_line(setting)])
