import pytest

from harness.common.isolation import trusted


@pytest.fixture
def read_here():
    """Read files in the process of the test itself: a fork for each takes longer than most of these tests do."""
    with trusted():
        yield


@pytest.fixture(scope="module")
def no_pictures():
    """Leave a run's pictures out, which take longer than a short run does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.report.pictures.draw_figures", lambda folder, pictured: folder.mkdir())
        yield
