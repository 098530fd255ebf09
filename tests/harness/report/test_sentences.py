import pytest

from harness.report.sentences import headlines, summary_sentences
from harness.scoring.metrics.registry import completed
from tests.harness.recorded_scene import metrics_of, write_recorded_scene


@pytest.fixture
def metrics(tmp_path):
    return metrics_of(write_recorded_scene(tmp_path / "run"))


def test_the_summary_counts_what_became_of_the_hidden_vehicles(metrics):
    text = " ".join(summary_sentences(metrics))
    assert (
        "came back once: none on the same track, 1 had lost it, none found it on another vehicle and none on nothing"
        in text
    )


@pytest.mark.parametrize(
    ("in_view", "hidden", "words"),
    [
        (
            95.0,
            80.0,
            "95 % of cases for vehicles in view (about right) and in 80 % of cases for hidden ones (too small",
        ),
        (99.0, 95.0, "99 % of cases for vehicles in view (too large"),
        (92.0, 92.0, "92 % of cases for vehicles in view (too small, it is surer than it should be) and in 92 % of"),
        (95.0, None, "95 % of cases for vehicles in view (about right)."),
    ],
)
def test_intervals_are_judged_for_vehicles_in_view_and_hidden_ones_apart(metrics, in_view, hidden, words):
    metrics["calibration"]["visible"]["coverage95"]["lon"] = in_view
    metrics["calibration"]["hidden"]["coverage95"]["lon"] = hidden
    assert words in " ".join(summary_sentences(metrics))


def test_slower_than_real_time_is_told_as_such(metrics):
    metrics["timing"]["realtime_factor"] = 0.5
    assert "2.0 times slower than real time" in summary_sentences(metrics)[-1]


def test_headlines_bear_the_metrics_numbers_and_intervals(metrics):
    metrics["mae"]["hidden"] |= {"position_m": 3.219, "position_m_ci95": [2.402, 4.056]}
    by_label = {headline.label: headline for headline in headlines(metrics)}
    assert by_label["Error, hidden"].value == "3.22 m"
    assert by_label["Error, hidden"].interval == "2.40 to 4.06 m"
    assert by_label["Same track after hiding"].value == "0 of 1"


def test_what_was_not_scored_is_left_out(metrics):
    empty = completed({}) | {key: metrics[key] for key in ("run", "timing", "traffic")}
    empty["occlusion"]["events"] = 0
    words = [*summary_sentences(empty), *(f"{headline.value} {headline.interval}" for headline in headlines(empty))]
    assert not any("None" in text or "nan" in text for text in words)
