"""The page of a run: one HTML file with text, numbers, figures and a replay; it needs no network."""

import base64
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from harness.common.charts import Charts
from harness.common.errors import InputError
from harness.common.files import check_unlinked, write_text
from harness.report.failures import brakings_of, failures_of
from harness.report.html_tables import error_table, hidden_table, mot_table, own_table, vehicle_table
from harness.report.key_figures import key_figures, key_table
from harness.report.replay_data import SecondRun, replay_data
from harness.report.run_charts import OVER_TIME, diagnostics_charts, diagnostics_of, error_charts, visibility_charts
from harness.report.summary_text import decision_summary, setting_sentence, summary_sentences
from harness.running.finished import RecordedRun, read_recorded_run
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.storage import ownership
from harness.storage import run_folder as runfolder

PAGE = runfolder.PAGE
MARK = b"his page is one file and needs no network"
"""By this a page of this program's is known."""
SCRIPTS = tuple(f"replay_{part}.js" for part in ("frame", "picture", "course", "differences", "control"))
MOST_SHOWN = 800_000
"""Rows of the truth that a page is made of; of a longer run it shows the beginning."""
LIBRARY = Path(__file__).parent / "vega" / "vega-embed.js.gz"
TEMPLATES = Environment(
    loader=PackageLoader("harness.report", "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
OVER_TIME_WORDS = "Mean absolute error over time for visible, partly hidden and hidden vehicles"


def write_run_page(folder: Path) -> Path:
    """Write ``report.html`` into a finished run's folder, and return it.

    Raises:
        InputError: It is no finished run's folder, or one of its files is missing or broken.
    """
    return put_page(folder, run_page(read_recorded_run(folder, "folder", MOST_SHOWN)))


def put_page(folder: Path, text: str) -> Path:
    """Write a folder's page and return it.

    Raises:
        InputError: Somebody else's page is there, or a link.
    """
    page = folder / PAGE
    check_unlinked(folder, [page], "folder")
    if page.exists() and (not page.is_file() or (page.stat().st_size and MARK not in page.read_bytes())):
        raise InputError(f"`folder`: {page} was not made by this program; give it another name")
    write_text(page, text)
    ownership.add(folder, [page])
    return page


def run_page(run: RecordedRun) -> str:
    """Return the page of a run."""
    recorded_s = run.truth["time_s"].max() - run.truth["time_s"].min() if len(run.truth) else 0.0
    shown = f"{recorded_s:.0f} s" if run.whole else f"replay and failures of its first {recorded_s:.0f} s"
    by_visibility = visibility_charts(run.metrics["mae"])
    # Of a long run the picture shows it all, where the chart would only know the beginning.
    over_time = error_charts(run.errors) if run.whole else Charts(())
    drawn, figures = run.folder / runfolder.FIGURES / OVER_TIME, key_figures(run)
    told = diagnostics_of(run)
    inside = diagnostics_charts(told) if told is not None else Charts(())
    return render(
        "run.html.j2",
        title=run.config.title(),
        run=run,
        duration=shown,
        version=version("mmpf-harness"),
        sentences=summary_sentences(run.metrics),
        setting=setting_sentence(run.metrics),
        key_figures=figures,
        figures_table=key_table(figures),
        failures=failures_of(run),
        decisions=decision_summary(run.metrics),
        brakings=brakings_of(run),
        lost=int(run.events["outcome"].isin(["lost", "hijacked"]).sum()),
        figures=[] if run.whole or not drawn.is_file() else [(embedded(drawn), OVER_TIME_WORDS)],
        error_table=error_table(run.metrics["mae"]),
        hidden_table=hidden_table(run.metrics["mae"]),
        mot_table=mot_table(run.metrics),
        own_table=own_table(run.metrics),
        config_text=(run.folder / runfolder.CONFIG).read_text(encoding="utf-8").strip(),
        facts=_facts(run.manifest),
        vehicles=vehicle_table(run.errors, run.events, run.step_s),
        sorting_script=Markup(_template_text("sorting.js")),
        by_visibility=by_visibility,
        over_time=over_time,
        inside=inside,
        **chart_parts([by_visibility, over_time, inside]),
        **replay_parts(run),
    )


def replay_parts(
    run: RecordedRun, beside: SecondRun | None = None, sides: tuple[tuple[str, str], ...] = ()
) -> dict[str, object]:
    """Return what the templates of the replay need, perhaps of another tracker too, in a pane of its own.

    ``sides`` has the heading of each of two panes and where its run lies.
    """
    runs = (run,) if beside is None else (run, beside.run)
    return {
        "sides": sides,
        "follow_m": FOLLOW_CUTOFF_M,
        "differ": beside is not None and beside.opens_at is not None,
        "has_particles": any(each.particles is not None for each in runs),
        "has_walls": len(run.road.walls_near(0.0, 0.0, np.inf)) > 0,
        "has_unseen": any(each.unseen is not None and len(each.unseen) for each in runs),
        "replay_json": _script_json(replay_data(run, beside)),
        "script": Markup("\n".join(_template_text(name) for name in SCRIPTS)),
    }


def chart_parts(groups: Sequence[Charts]) -> dict[str, object]:
    """Return what the templates of the charts need: nothing of the library where there are no charts."""
    specs = [chart.spec for group in groups for chart in group.charts]
    return {
        "chart_json": _script_json(specs) if specs else None,
        "chart_library": base64.b64encode(LIBRARY.read_bytes()).decode("ascii") if specs else "",
        "chart_script": Markup(_template_text("charts.js")),
    }


def render(template: str, **values: object) -> str:
    """Return a page from one of the package's templates."""
    return TEMPLATES.get_template(template).render(style=Markup(_template_text("style.css")), **values)


def embedded(picture: Path) -> str:
    """Return a picture as a data address."""
    kind = "svg+xml" if picture.suffix == ".svg" else picture.suffix.removeprefix(".")
    return f"data:image/{kind};base64,{base64.b64encode(picture.read_bytes()).decode('ascii')}"


def _facts(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    machine = manifest["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number)
    facts = {
        "command": manifest["command"],
        "versions": versions,
        "source revision": manifest["git_revision"],
        "machine": f"{machine['system']}, {machine['processor']}, {machine['cores']} cores",
        "wall time": ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in manifest["wall_times_s"].items()),
        "inputs, SHA-256": ", ".join(f"{name} {digest[:16]}…" for name, digest in manifest["inputs_sha256"].items()),
    }
    return [(name, str(value)) for name, value in facts.items() if value]


def _script_json(value: object) -> Markup:
    """Return JSON that can stand in a script element: no text in it can end the element."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def _template_text(name: str) -> str:
    return (Path(__file__).parent / "templates" / name).read_text(encoding="utf-8")
