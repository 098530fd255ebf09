"""The recorded scene as a finished run, and a real browser, without a screen and without a network."""

import shutil

import pytest

from harness.running.finished import RecordedRun, read_recorded_run
from tests.harness.recorded_scene import write_recorded_scene

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")


@pytest.fixture
def run(tmp_path) -> RecordedRun:
    return read_recorded_run(write_recorded_scene(tmp_path / "run"))


@pytest.fixture(scope="session")
def browser():
    """Return a driven browser; without one on the machine the test is skipped."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium drives the browser")
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("no chromium with chromedriver on this machine")
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    quiet = ("no-first-run", "disable-background-networking")
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", *quiet):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(executable_path=str(DRIVER)))
    yield driver
    driver.quit()
