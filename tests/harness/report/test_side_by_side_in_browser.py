"""Two trackers side by side in a real browser: one clock, one camera, and the way from difference to difference."""

import pytest

from harness.analysis.compare import compare
from harness.analysis.sources import open_source
from harness.report.comparison_page import comparison_page
from tests.harness.recorded_scene import GIVEN_UP, LAST_SEEN, write_lost_and_kept
from tests.harness.report.test_replay_in_browser import asked

selenium = pytest.importorskip("selenium", reason="selenium drives the browser")
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    """Return the page of a run that loses *far*, beside one that follows it 1 m ahead all the time."""
    lost, kept = write_lost_and_kept(tmp_path_factory.mktemp("runs"))
    page = lost.parent / "page.html"
    page.write_text(comparison_page(compare(open_source(str(lost), "a"), open_source(str(kept), "b"))))
    return page.as_uri()


@pytest.fixture
def page(browser, address):
    browser.set_window_size(1280, 900)
    browser.get("about:blank")
    browser.get(f"{address}#t=0")
    return browser


def pictures(page) -> list[str]:
    return page.execute_script("return ['road', 'road-b'].map(id => document.getElementById(id).toDataURL())")


def press(page, key: str) -> None:
    page.find_element(By.ID, "road").send_keys(key)


def test_it_opens_where_the_trackers_first_differ_for_most_vehicles(page, address):
    page.get("about:blank")
    page.get(address)
    assert (asked(page, "step"), asked(page, "followed")) == (LAST_SEEN + 1, "far")


def test_both_pictures_move_with_one_clock_and_one_camera(page):
    before = pictures(page)
    press(page, Keys.ARROW_RIGHT)
    moved = pictures(page)
    assert all(old != new for old, new in zip(before, moved, strict=True))
    page.find_element(By.ID, "nearer").click()
    nearer = pictures(page)
    assert all(old != new for old, new in zip(moved, nearer, strict=True))
    second = page.find_element(By.ID, "road-b")
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", second)
    for across, along in ((0, 40), (50, 0)):
        held = pictures(page)
        ActionChains(page).drag_and_drop_by_offset(second, along, across).perform()
        assert all(old != new for old, new in zip(held, pictures(page), strict=True)), "dragging one moves both"


def test_the_way_leads_from_difference_to_difference(page):
    line = page.find_element(By.ID, "differences-line")
    assert line.text == "Here the two do not differ."
    page.find_element(By.ID, "next-difference").click()
    assert asked(page, "step") == LAST_SEEN + 1
    assert asked(page, "followed") == "far"
    assert line.text == "Here a is over 1 m farther from far."
    press(page, "n")
    assert asked(page, "step") == GIVEN_UP
    assert line.text == "Here b alone follows far."
    press(page, "p")
    assert asked(page, "step") == LAST_SEEN + 1
    assert page.execute_script("return location.hash") == f"#t={(LAST_SEEN + 1) / 10:.1f}&vehicle=far"


def test_keys_work_wherever_the_focus_is(page):
    for control in ("play", "scrub", "speed", "stacked", "follow", "next-difference"):
        element = page.find_element(By.ID, control)
        page.execute_script("arguments[0].focus()", element)
        before = asked(page, "step")
        element.send_keys("n")
        if control in ("speed", "follow"):
            continue  # letters choose in lists
        assert asked(page, "step") != before, control
        page.find_element(By.ID, "road").send_keys(Keys.HOME)
    page.execute_script("document.activeElement.blur()")
    ActionChains(page).send_keys("n").perform()
    assert asked(page, "step") == LAST_SEEN + 1


def test_the_screen_can_be_filled_and_left(page):
    press(page, "f")
    WebDriverWait(page, 10).until(lambda page: page.execute_script("return !!document.fullscreenElement"))
    assert page.execute_script("return document.fullscreenElement.id") == "replay"
    heights = page.execute_script("return ['road', 'road-b'].map(id => document.getElementById(id).clientHeight)")
    assert heights[0] == heights[1] > 0.4 * page.execute_script("return innerHeight")
    press(page, "f")
    WebDriverWait(page, 10).until(lambda page: page.execute_script("return !document.fullscreenElement"))


def test_the_pictures_stand_one_above_the_other_where_that_is_asked_for_or_the_screen_is_narrow(page):
    def tops() -> list[float]:
        top = "document.getElementById(id).getBoundingClientRect().top"
        return page.execute_script(f"return ['road', 'road-b'].map(id => {top})")

    first, second = tops()
    assert abs(first - second) < 30
    page.find_element(By.ID, "stacked").click()
    first, second = tops()
    assert second - first > 150
    page.find_element(By.ID, "stacked").click()
    page.set_window_size(700, 900)
    first, second = tops()
    assert second - first > 150
    fits = "return document.documentElement.scrollWidth <= innerWidth"  # charts are drawn anew a moment later
    WebDriverWait(page, 10).until(lambda page: page.execute_script(fits))


def test_the_chart_of_a_followed_vehicle_tells_of_both(page):
    Select(page.find_element(By.ID, "follow")).select_by_visible_text("far")
    page.execute_script(f"location.hash = '#t={(LAST_SEEN + 1) / 10}&vehicle=far'")
    words = page.find_element(By.ID, "followed-line")
    WebDriverWait(page, 10).until(lambda _: "a:" in words.text)
    assert "a: followed by track 2, 3.0 m off; b: followed by track 2, 1.0 m off" in words.text


def test_the_page_loads_without_a_complaint_in_light_and_dark(browser, address):
    for scheme in ("light", "dark"):
        setting = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", setting)
        browser.get("about:blank")
        browser.get(address)
        WebDriverWait(browser, 30).until(lambda p: p.execute_script("return document.documentElement.dataset.charts"))
        assert [entry["message"] for entry in browser.get_log("browser")] == []
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
