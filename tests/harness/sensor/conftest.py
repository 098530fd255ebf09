import pytest


@pytest.fixture(scope="module")
def no_shadows():
    """Leave out the sensor's shadows, which take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.sensor.detector.free_space", lambda *_: None)
        yield
