"""What a comparison says, word for word: on the page, in a comment, and on the screen."""

from __future__ import annotations

import math

import pytest

from harness.analysis.compare import Judgement
from harness.analysis.comparison_text import EXPLANATION, MOST_MOMENTS, as_markdown, conclusion, print_comparison
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE, Rules, Verdict
from harness.analysis.why import CAUSES, KINDS, TrackFailure, Why

HOTA, IDF1 = "mot.hota", "mot.idf1"
NOTHING = math.nan


def verdict(metric: str = HOTA, word: str = NO_WORSE, **other: object) -> Verdict:
    """Return a verdict on b, which has 78 where a has 80, unless said otherwise."""
    known: dict[str, object] = {
        "label": "mmpf cvm", "metric": metric, "primary": True, "a": 80.0, "b": 78.0, "difference": -2.0,
        "ci95": (-3.25, -0.75), "p": 0.0126, "pairs": 12, "units": 12.0, "margin": 4.0, "verdict": word,
        "regression": word == WORSE,
    }  # fmt: skip
    return Verdict(**(known | other))  # type: ignore[arg-type]


def comparison(*verdicts: Verdict, **other: object) -> Judgement:
    return Judgement("old", "new", verdicts, ("A note.", "Another."), Rules(), **other)  # type: ignore[arg-type]


def failure(place: int, kind: str = KINDS[0], cause: str = CAUSES[0]) -> TrackFailure:
    return TrackFailure(kind, cause, f"flow {place}", 3.1 + place, 1, 2)


@pytest.mark.parametrize(
    ("found", "sentence"),
    [
        (
            [verdict(), verdict(IDF1, BETTER)],
            "No worse: b is nowhere worse by more than 2 %; of 2 verdicts 0 worse, 0 undecided, 1 no worse, 1 better.",
        ),
        (
            [verdict(word=WORSE), verdict(IDF1, WORSE, difference=-8.0), verdict(IDF1, UNDECIDED)],
            "Worse: b is worse in HOTA in sight (-2.5 %), IDF1 in sight (-10.0 %); "
            "of 3 verdicts 2 worse, 1 undecided, 0 no worse, 0 better.",
        ),
        (
            [verdict(word=UNDECIDED), verdict(IDF1, UNTESTED, primary=False)],
            "Undecided: of 1 verdicts 0 worse, 1 undecided, 0 no worse, 0 better.",
        ),
    ],
)
def test_the_conclusion_is_a_sentence_with_the_number_of_each_verdict(found, sentence):
    assert conclusion(comparison(*found)) == sentence


def test_the_tolerance_of_the_rules_is_told():
    told = Judgement("old", "new", (verdict(),), (), Rules(tolerance=0.025))
    assert "nowhere worse by more than 2.5 %;" in conclusion(told)


def test_the_page_has_a_table_for_each_tracker_with_each_number_once():
    found = comparison(
        verdict(word=WORSE),
        verdict(IDF1, UNTESTED, b=NOTHING, difference=NOTHING, ci95=(NOTHING, NOTHING), p=NOTHING, pairs=3),
        verdict(label="jpda", a=0.0, b=2.0, difference=2.0, ci95=(-1.0, 5.0), p=0.5),
    )
    lines = as_markdown(found).splitlines()
    heading = "| metric | a | b | difference | 95 % interval | p | pairs | verdict on b |"
    rule = "| " + " | ".join(["---"] * 8) + " |"
    assert lines == [
        f"## {conclusion(found)}",
        "",
        "a: `old`, b: `new`",
        "",
        "### mmpf cvm",
        "",
        heading,
        rule,
        "| HOTA in sight, % | 80.00 | 78.00 | -2.00 (-2.5 %) | -3.25 to -0.75 | 0.013 | 12 | **worse** |",
        "| IDF1 in sight, % | 80.00 | - | - | - | - | 3 | not tested |",
        "",
        "### jpda",
        "",
        heading,
        rule,
        "| HOTA in sight, % | 0.00 | 2.00 | +2.00 | -1.00 to +5.00 | 0.500 | 12 | **no worse** |",
        "",
        "A note.",
        "Another.",
        "",
        EXPLANATION,
    ]


def test_what_is_undecided_says_why_before_anything_else():
    found = comparison(verdict(word=UNDECIDED, more_units=7))
    (reason,) = found.reasons
    assert as_markdown(found).splitlines()[:5] == [f"## {conclusion(found)}", "", reason, "", "a: `old`, b: `new`"]
    assert "about 7 more seeds" in reason
    worse = comparison(verdict(word=WORSE), verdict(IDF1, UNDECIDED, more_units=7))
    assert "7 more seeds" not in as_markdown(worse)


def test_causes_are_counted_by_kind_and_run_and_every_moment_leads_to_its_replay():
    why = Why((failure(0), failure(1, KINDS[1], CAUSES[1]), failure(2)), (failure(3, KINDS[1], CAUSES[-1]),), "A", "B")
    lines = as_markdown(comparison(verdict(), why=why)).splitlines()
    begin = lines.index("### Why")
    nought = [0] * len(CAUSES)

    def row(name: str, counts: dict[int, int]) -> str:
        cells = [str(counts.get(place, 0)) for place in range(len(nought))]
        return f"| {name} | {' | '.join(cells)} | {sum(counts.values())} |"

    assert lines[begin + 2 : begin + 8] == [
        f"|  | {' | '.join(CAUSES)} | all |",
        "| " + " | ".join(["---"] * (len(CAUSES) + 2)) + " |",
        row(f"{KINDS[0]}, a", {0: 2}),
        row(f"{KINDS[0]}, b", {}),
        row(f"{KINDS[1]}, a", {1: 1}),
        row(f"{KINDS[1]}, b", {len(CAUSES) - 1: 1}),
    ]
    begin = lines.index("Moments of a:")
    assert lines[begin + 1 : begin + 5] == [
        "",
        "| moment | what | cause | vehicle |",
        "| --- | --- | --- | --- |",
        f"| [3.1 s](A/report.html#t=2.1&vehicle=flow%200) | {KINDS[0]} | {CAUSES[0]} | flow 0 |",
    ]
    assert f"| [6.1 s](B/report.html#t=5.1&vehicle=flow%203) | {KINDS[1]} | {CAUSES[-1]} | flow 3 |" in lines
    on_page = as_markdown(comparison(verdict(), why=why), with_replay=True)
    assert "[3.1 s](#t=2.1&vehicle=flow%200)" in on_page
    assert "report.html" not in on_page


def test_of_many_moments_the_first_are_listed_and_of_none_nothing_is():
    why = Why(tuple(failure(place) for place in range(MOST_MOMENTS + 3)), (), "A", "B")
    lines = as_markdown(comparison(verdict(), why=why)).splitlines()
    assert f"Moments of a, the first {MOST_MOMENTS} of {MOST_MOMENTS + 3}:" in lines
    assert sum(line.startswith("| [") for line in lines) == MOST_MOMENTS
    assert not any(line.startswith("Moments of b") for line in lines)
    just = Why(why.a[:MOST_MOMENTS], (), "A", "B")
    assert "Moments of a:" in as_markdown(comparison(verdict(), why=just)).splitlines()


def test_the_screen_shows_what_fits_eighty_columns_causes_notes_and_the_conclusion(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    why = Why((failure(0),), (), "A", "B")
    found = comparison(
        verdict(word=UNDECIDED, more_units=7), verdict(IDF1, UNTESTED, primary=False), verdict(label="jpda"), why=why
    )
    print_comparison(found)
    out, err = capsys.readouterr()
    assert out == ""
    lines = [line.rstrip() for line in err.splitlines()]
    assert lines[:4] == ["", "a: old", "b: new", "mmpf cvm"]
    words = [line.split() for line in lines]
    assert words[4] == ["metric", "a", "b", "b", "-", "a", "95", "%", "interval", "pairs", "b", "is"]
    row = ["80.00", "78.00", "-2.00", "-3.25", "to", "-0.75", "12"]
    assert words[5] == ["HOTA", "in", "sight,", "%", *row, "undecided"]
    assert words[6] == ["IDF1", "in", "sight,", "%", *row]
    assert lines[7] == "jpda"
    assert words[9] == ["HOTA", "in", "sight,", "%", *row, "no", "worse"]
    assert lines[10] == "why"
    assert words[11] == [*" ".join(CAUSES).split(), "all"]
    assert words[12] == [*f"{KINDS[0]}, a".split(), "1", *["0"] * (len(CAUSES) - 1), "1"]
    assert lines[16:18] == ["A note.", "Another."]
    assert " ".join(lines[18:]) == f"{conclusion(found)} {found.reasons[0]}"
