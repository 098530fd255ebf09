"""The pages of the documentation: those that list what the code declares are current, and every example is valid."""

import importlib.util
import re
from pathlib import Path

import pandas as pd
import pytest
from scipy.stats import t as student

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
CURRENT = ("commands.md", "settings.md", "tables.md", "metrics.md", "exit-codes.md", "evidence.md")
MOST_WORDS = 18_000
GENERATED = "<!-- Written by .ci/reference_pages.py. -->"


def pages() -> list[Path]:
    made = {"_build", "gallery", "reference-results"}
    return sorted(page for page in DOCS.rglob("*.md") if not made & set(page.relative_to(DOCS).parts))


def script():
    spec = importlib.util.spec_from_file_location("reference_pages", ROOT / ".ci" / "reference_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", CURRENT)
def test_a_page_that_is_written_from_the_code_is_current(name):
    page = (DOCS / "reference" / name).read_text(encoding="utf-8")
    assert page == script().PAGES[name](), "run python .ci/reference_pages.py"


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages()], ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_python_examples_compile(page):
    for code in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL):
        compile(code, str(page), "exec")


def test_hand_written_pages_stay_short():
    texts = (page.read_text(encoding="utf-8") for page in pages())
    assert sum(len(text.split()) for text in texts if GENERATED not in text) <= MOST_WORDS


@pytest.mark.parametrize("page", [ROOT / "README.md", *pages()], ids=lambda page: page.name)
def test_a_table_of_results_holds_the_figures_of_its_reference(page):
    """A row says in a comment which column of the reference table it shows; a cell has one figure for each density."""
    text = page.read_text(encoding="utf-8")
    for name, table in re.findall(r"<!-- table: (\w+) -->\n((?:.*\n)+?)\n", text):
        reference = read_tables((ROOT / "results" / "reference" / name / "table.md").read_text(encoding="utf-8"))
        header, _, *rows = [cells(line) for line in table.strip().splitlines() if line.startswith("|")]
        for label, *shown in rows:
            column = re.search(r"<!-- (.*) -->", label)[1]
            for tracker, cell in zip(header[1:], shown, strict=True):
                key = re.search(r"<!-- (.*) -->", tracker)[1]
                expected = [mean for (row, _, heading), mean in reference.items() if (row, heading) == (key, column)]
                assert [float(part) for part in cell.split("/")] == expected, (label, tracker)


def test_what_the_page_of_results_says_of_worlds_is_what_their_runs_give():
    runs = pd.read_parquet(ROOT / "results" / "reference" / "worlds" / "runs.parquet")
    hota = runs.pivot_table("mot.hota", ["mismatch", "density"], "variant")
    lead = (hota["mmpf"] - hota[["pmbm", "pmbm-doubting"]].max(axis=1)).round(1)
    halved, doubled = (hota[f"mmpf-{each}"] - hota["mmpf"] for each in ("halved", "doubled"))
    posts, ahead = -lead["posts"][20.0], lead[lead > 0.0]
    assert len(ahead) == len(lead) - 1
    text = " ".join((DOCS / "results" / "index.md").read_text(encoding="utf-8").split())
    assert (
        f"with posts (by {posts}). Elsewhere `mmpf` is ahead of both, by {ahead.min()} to {ahead.max()} points" in text
    )
    costs, gains = -halved.min(), doubled.max()
    assert (
        f"up to {costs:.1f} points. Doubling them gains up to {gains:.1f} and costs up to {-doubled.min():.1f}" in text
    )


def test_what_the_readme_says_below_its_table_is_what_the_runs_give():
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    trackers, stopped = (
        pd.read_parquet(ROOT / f"results/reference/{name}/runs.parquet") for name in ("trackers", "stopped")
    )
    cost = trackers.pivot_table("hidden.hidden_cost_m", ["seed", "density"], "variant").groupby("seed").mean()
    for other in ("pmbm-doubting", "pmbm"):
        less = cost[other] - cost["mmpf"]
        half = student.isf(0.025, len(less) - 1) * less.sem()
        assert f"{less.mean():.2f} m [{less.mean() - half:.2f}, {less.mean() + half:.2f}] smaller" in text
    missed = trackers.groupby("variant")["decisions.missed"].sum()[["mmpf", "pmbm-doubting", "oracle-kalman"]]
    assert f"misses {missed.min():.0f} or {missed.max():.0f} brakings in the twenty runs" in text
    means = stopped.groupby(["mismatch", "variant"]).mean(numeric_only=True)
    mine, doubting, usual = means.loc["as is", "in_plain_view.stopped_recall"][["mmpf", "pmbm-doubting", "pmbm"]]
    assert f"{mine:.1f} % of the time with `mmpf`, {doubting:.1f} % with `pmbm-doubting` and {usual:.1f} % with" in text
    mine, usual = means.loc["darker", "in_plain_view.worst_tenth"][["mmpf", "pmbm"]]
    assert f"{mine:.1f} % of its time in plain view with `mmpf`, and for {usual:.1f} % with default" in text


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def read_tables(text: str) -> dict[tuple[str, str, str], float]:
    """Return the means of a reference table by tracker, density and column."""
    means, header = {}, []
    for line in text.splitlines():
        row = cells(line) if line.startswith("| ") else []
        if row[:2] == ["tracker", "density"]:
            header = row
        elif row and not row[0].startswith("---") and len(row) == len(header):
            for heading, cell in zip(header[2:], row[2:], strict=True):
                if number := re.match(r"-?[\d.]+", cell):
                    means[row[0], row[1], heading] = float(number[0])
    return means
