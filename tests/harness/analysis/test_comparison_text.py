"""What a comparison says, word for word: on the page, in a comment, and on the screen."""

from harness.analysis.compare import Judgement
from harness.analysis.comparison_text import MOST_MOMENTS, as_markdown, conclusion, print_comparison
from harness.analysis.rules import Rules
from harness.analysis.verdicts import NO_WORSE, UNDECIDED, UNTESTED, WORSE, Verdict
from harness.analysis.why import CAUSES, KINDS, TrackFailure, Why
from harness.scoring.metrics.hidden_cost import FALSE_HIDDEN

HOTA, IDF1 = "mot.hota", "mot.idf1"


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


def test_what_is_undecided_says_why_before_anything_else():
    found = comparison(verdict(word=UNDECIDED, more_units=7))
    (reason,) = found.reasons
    assert as_markdown(found).splitlines()[:5] == [f"## {conclusion(found)}", "", reason, "", "a: `old`, b: `new`"]
    assert "about 7 more seeds" in reason
    assert "| **undecided**, the interval does not decide |" in as_markdown(found)
    worse = comparison(verdict(word=WORSE), verdict(IDF1, UNDECIDED, more_units=7))
    assert "7 more seeds" not in as_markdown(worse)


def test_the_screen_begins_with_the_verdict_and_shows_what_is_judged_and_false_hidden_tracks(capsys):
    beside = verdict(FALSE_HIDDEN, UNTESTED, primary=False)
    found = comparison(verdict(word=WORSE), verdict(IDF1, NO_WORSE, primary=False), beside)
    print_comparison(found)
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[0].startswith("Worse: b is worse in HOTA in sight")
    assert [line.split()[0] for line in lines if "80.00" in line] == ["HOTA", "false"]
    assert any(line.startswith("Other metrics, not judged: 1;") for line in lines)


def test_of_many_moments_the_first_are_listed_and_of_none_nothing_is():
    why = Why(tuple(failure(place) for place in range(MOST_MOMENTS + 3)), (), "A", "B")
    lines = as_markdown(comparison(verdict(), why=why)).splitlines()
    assert f"Moments of a, the first {MOST_MOMENTS} of {MOST_MOMENTS + 3}:" in lines
    assert sum(line.startswith("| [") for line in lines) == MOST_MOMENTS
    assert not any(line.startswith("Moments of b") for line in lines)
    just = Why(why.a[:MOST_MOMENTS], (), "A", "B")
    assert "Moments of a:" in as_markdown(comparison(verdict(), why=just)).splitlines()
