"""The outcome of a comparison for CI: as JUnit XML and as a short summary."""

import re
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree

from harness.analysis.compare import Judgement
from harness.analysis.comparison_text import HEADINGS, cells, conclusion
from harness.analysis.verdicts import UNDECIDED, WORSE, Verdict
from harness.analysis.why import moment_of
from harness.common.markdown import markdown_table

SUITE = "harness.compare"
WHOLE = "runs and metrics of both sides"
MOST_MOMENTS = 10
_NOT_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(comparison: Judgement) -> str:
    """Return JUnit's XML: a test case for each verdict, a failure where b is worse, skipped where that is undecided.

    One more case, skipped too, says what is missing that belongs to no single verdict.
    """
    judged = comparison.primary
    suite = ElementTree.Element("testsuite", name=SUITE)
    for verdict in judged:
        case = ElementTree.SubElement(suite, "testcase", classname=_plain(verdict.label), name=_plain(verdict.metric))
        _tell(case, verdict.verdict, in_a_line(verdict))
    whole = ElementTree.SubElement(suite, "testcase", classname=SUITE, name=WHOLE)
    missing = comparison.missing if any(each.verdict == UNDECIDED for each in judged) else comparison.reasons
    _tell(whole, UNDECIDED if missing else "", " ".join(missing))
    counts = {"tests": suite.iter("testcase"), "failures": suite.iter("failure"), "skipped": suite.iter("skipped")}
    for name, found in counts.items():
        suite.set(name, str(len(list(found))))
    suite.set("errors", "0")
    ElementTree.indent(suite)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n"


def as_summary(comparison: Judgement, pages: str | None = None) -> str:
    """Return the judged metrics and what stands against a verdict as Markdown that needs no other file.

    ``pages`` is the address below which the folders' pages lie; None where nothing leads to them.
    """
    reasons = comparison.reasons if comparison.outcome != WORSE else comparison.missing
    lines = [f"### {conclusion(comparison)}", "", *(f"- {reason}" for reason in reasons)]
    lines += [f"- Differs: {what}" for what in comparison.differing] + [""]
    rows = [[verdict.label, *cells(verdict)] for verdict in comparison.primary]
    lines += [*markdown_table(("tracker", *HEADINGS), rows), "", comparison.paired, ""]
    if comparison.why is not None and pages is not None:
        why = comparison.why
        for side, found, folder in (("a", why.a, why.folder_a), ("b", why.b, why.folder_b)):
            page = f"{pages.rstrip('/')}/{quote(Path(folder).name)}/report.html"
            moments = [f"[{each.time_s:.1f} s]({page}{moment_of(each)}) {each.kind}" for each in found[:MOST_MOMENTS]]
            if moments:
                lines += [f"Moments of {side}: {', '.join(moments)}.", ""]
    return "\n".join(lines)


def in_a_line(verdict: Verdict) -> str:
    """Return a verdict in a line."""
    label, a, b, difference, interval, p, pairs, word = cells(verdict)
    why = "; ".join(filter(None, (verdict.breach, verdict.wanting)))
    more = f"; about {verdict.more_units} more needed" if verdict.more_units is not None else ""
    told = f"{label}: {word}: {a} to {b}, difference {difference}, 95 % interval {interval}, p {p}, {pairs} pairs"
    return f"{told}{f'; {why}' if why else ''}{more}"


def _tell(case: ElementTree.Element, word: str, message: str) -> None:
    if (kind := {WORSE: "failure", UNDECIDED: "skipped"}.get(word)) is not None:
        ElementTree.SubElement(case, kind, message=_plain(message)).text = _plain(message)
    elif message:
        ElementTree.SubElement(case, "system-out").text = _plain(message)


def _plain(text: str) -> str:
    """Return a text without the characters that no XML may hold."""
    return _NOT_XML.sub("?", text)
