"""The page in a real browser, without a screen and without a network."""

import time
from itertools import combinations

import pandas as pd
import pytest

from harness.report.folder_page import text_page
from harness.report.page import write_run_page
from tests.harness.recorded_scene import (
    GIVEN_UP,
    LAST_SEEN,
    NEW_TRACK,
    SEEN_AGAIN,
    STEPS,
    rewrite,
    write_recorded_scene,
)

selenium = pytest.importorskip("selenium", reason="selenium drives the browser")
from selenium import webdriver  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

pytestmark = pytest.mark.slow
DESK, PHONE = (1280, 900), {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    return write_run_page(write_recorded_scene(tmp_path_factory.mktemp("runs") / "run")).as_uri()


@pytest.fixture
def page(browser, address) -> webdriver.Chrome:
    browser.set_window_size(*DESK)
    browser.get("about:blank")
    browser.get(f"{address}#t=0")
    return browser


def asked(page, question: str):
    return page.execute_script(f"return replay.{question}()")


def click_vehicle(page, name: str) -> None:
    road = page.find_element(By.ID, "road")
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", road)
    x, y = asked(page, "positions")[name]
    from_middle = round(x - road.size["width"] / 2), round(y - road.size["height"] / 2)
    ActionChains(page).move_to_element_with_offset(road, *from_middle).click().perform()


def seek(page, step: int) -> None:
    page.execute_script(
        f"const s = document.getElementById('scrub'); s.value = {step}; s.dispatchEvent(new Event('input'))"
    )


def test_the_page_loads_without_a_complaint_and_fetches_nothing(page):
    assert page.get_log("browser") == []
    fetched = "performance.getEntriesByType('resource').map(e => e.name).filter(name => !name.startsWith('data:'))"
    assert page.execute_script(f"return {fetched}") == []
    painted = page.execute_script(
        "const c = document.getElementById('road');"
        "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "const seen = new Set(); for (let k = 0; k < d.length; k += 4) seen.add(d[k] << 16 | d[k+1] << 8 | d[k+2]);"
        "return [0x009E73, 0xe0e0e0, 0x882255].map(colour => seen.has(colour))"
    )
    assert painted == [True, True, True], "a visible vehicle, a shadow and a track are on the road"


def test_play_advances_and_pause_stops(page):
    play = page.find_element(By.ID, "play")
    Select(page.find_element(By.ID, "speed")).select_by_value("0.5")
    play.click()
    WebDriverWait(page, 10).until(lambda page: asked(page, "step") > 2)
    play.click()
    assert asked(page, "playing") is False
    stopped = asked(page, "step")
    time.sleep(0.3)
    assert asked(page, "step") == stopped


def test_the_replay_stops_at_its_end_and_starts_over(page):
    seek(page, STEPS - 2)
    play = page.find_element(By.ID, "play")
    play.click()
    WebDriverWait(page, 10).until(lambda page: not asked(page, "playing"))
    assert asked(page, "step") == STEPS - 1
    play.click()
    assert asked(page, "playing") is True
    assert asked(page, "step") < STEPS - 1


def test_clicking_a_vehicle_tells_its_name_its_fate_and_its_course(page):
    seek(page, GIVEN_UP - 1)
    click_vehicle(page, "far")
    assert asked(page, "followed") == "far"
    words = page.find_element(By.ID, "followed-line")
    assert words.text == "far: 20.0 m/s, hidden, followed by track 2, 3.0 m off."
    assert page.find_element(By.ID, "chart").is_displayed()
    seek(page, GIVEN_UP)
    assert words.text == "far: 20.0 m/s, hidden, its track was deleted."


def test_everything_works_from_the_keyboard(page):
    road = page.find_element(By.ID, "road")
    road.send_keys(Keys.ARROW_RIGHT)
    assert asked(page, "step") == 1
    road.send_keys(Keys.SHIFT + Keys.ARROW_RIGHT)
    assert asked(page, "step") == 11
    road.send_keys(Keys.ARROW_LEFT)
    assert asked(page, "step") == 10
    road.send_keys(Keys.SPACE)
    assert asked(page, "playing") is True
    road.send_keys(Keys.SPACE)
    assert asked(page, "playing") is False
    Select(page.find_element(By.ID, "follow")).select_by_visible_text("near")
    assert asked(page, "followed") == "near"
    road.send_keys(Keys.ESCAPE)
    assert asked(page, "followed") is None
    assert page.get_log("browser") == []


def test_the_replay_opens_where_the_worst_failure_ends_and_its_button_shows_the_whole_of_it(browser, address):
    browser.get("about:blank")
    browser.get(address)
    assert (asked(browser, "step"), asked(browser, "followed")) == (SEEN_AGAIN, "far")
    assert "It opens at the end of the worst failure" in browser.find_element(By.ID, "replay").text
    browser.find_element(By.CSS_SELECTOR, "#replay button[data-vehicle]").click()
    assert LAST_SEEN <= asked(browser, "step") < SEEN_AGAIN


def test_a_failure_is_watched_in_the_replay(page):
    page.find_element(By.CSS_SELECTOR, "button[data-vehicle]").click()
    assert asked(page, "followed") == "far"
    assert asked(page, "playing") is True
    assert 20 <= asked(page, "step") < 40


def test_a_link_leads_to_a_moment_and_its_vehicle(page, address):
    for moment_s, step in (("1.5", 15), ("99", None)):
        page.get("about:blank")
        page.get(f"{address}#t={moment_s}&vehicle=far")
        last = page.execute_script("return Number(document.getElementById('scrub').max)")
        assert asked(page, "step") == (last if step is None else step)
        assert asked(page, "followed") == "far"


def test_a_layer_can_be_hidden(page):
    shot = "return document.getElementById('road').toDataURL()"
    before = page.execute_script(shot)
    page.find_element(By.CSS_SELECTOR, "#layers summary").click()
    box = page.find_element(By.CSS_SELECTOR, "input[data-layer=shadows]")
    box.click()
    assert page.execute_script(shot) != before
    box.click()
    assert page.execute_script(shot) == before


def test_words_on_the_road_do_not_overlap(browser, tmp_path):
    folder = write_recorded_scene(tmp_path / "run")
    tracks = pd.read_parquet(folder / "tracks.parquet")
    rewrite(folder, "tracks.parquet", tracks.assign(lon_m=tracks["lon_m"].iloc[0], lat_m=tracks["lat_m"].iloc[0]))
    browser.get(f"{write_run_page(folder).as_uri()}#t=0")
    words = asked(browser, "words")
    assert len(words) == 4, "the scale, the ego and the numbers of two tracks in one place"
    assert all(a[1] <= b[0] or b[1] <= a[0] or a[3] <= b[2] or b[3] <= a[2] for a, b in combinations(words, 2))


def test_every_control_has_a_name(page):
    unnamed = page.execute_script(
        "const named = e => (e.getAttribute('aria-label') || e.textContent.trim() || (e.labels && e.labels.length));"
        "return [...document.querySelectorAll('button, select, input, canvas')].filter(e => !named(e))"
        ".map(e => e.outerHTML)"
    )
    assert unnamed == []


LIGHT = """
const linear = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
const ratio = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
"""
FAINT_TEXTS = """
const numbers = text => text.match(/[\\d.]+/g).map(Number);
const opaque = c => c.length === 3 || c[3] > 0;
const ground = e => { while (e) { const c = numbers(getComputedStyle(e).backgroundColor); if (opaque(c)) return c;
  e = e.parentElement; } return [255, 255, 255]; };
const contrast = e => ratio(light(numbers(getComputedStyle(e).color)), light(ground(e)));
const written = e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()) && e.offsetParent;
const texts = [...document.body.querySelectorAll("*")].filter(e => written(e) && e.tagName !== "SCRIPT");
return [texts.length, texts.filter(e => contrast(e) < 4.5).map(e => e.outerHTML.slice(0, 100)),
  light(ground(document.body))];
"""
FAINT_MARKS = """
const seen = colour => light(colour.match(/[0-9a-f]{2}/gi).map(pair => parseInt(pair, 16)));
const { marks, grounds } = replay.colours();
return [marks.filter(mark => grounds.some(ground => !(ratio(seen(mark), seen(ground)) >= 3))), seen(grounds[0])];
"""


@pytest.mark.parametrize(("scheme", "is_dark"), [("light", False), ("dark", True)])
def test_the_pages_follow_the_readers_scheme_and_stay_readable(browser, address, tmp_path, scheme, is_dark):
    verdicts = "# Verdicts\n\n| b is |\n|---|\n| **better** |\n| **worse** |\n| no difference |\n\n`code`\n"
    (tmp_path / "verdicts.html").write_text(text_page(verdicts), encoding="utf-8")
    setting = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", setting)
    try:
        for page, least in ((address, 80), ((tmp_path / "verdicts.html").as_uri(), 6)):
            browser.get(page)
            count, faint, ground = browser.execute_script(LIGHT + FAINT_TEXTS)
            assert count >= least
            assert (faint, ground < 0.1) == ([], is_dark)
        browser.get(address)
        faint, ground = browser.execute_script(LIGHT + FAINT_MARKS)
        assert (faint, ground < 0.1) == ([], is_dark), "pictures follow the scheme too"
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_the_page_fits_a_phone(browser, address):
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    try:
        browser.get(address)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= PHONE["width"]
        click_vehicle(browser, "near")
        assert asked(browser, "followed") == "near"
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_table_of_vehicles_sorts_and_leads_to_a_vehicles_worst_moment(page):
    def names() -> list[str]:
        return [cell.text for cell in page.find_elements(By.CSS_SELECTOR, "#vehicles tbody th")]

    assert names() == ["far", "near"], "the costliest comes first"
    seen = page.find_elements(By.CSS_SELECTOR, "#vehicles thead th")[1]
    seen.find_element(By.TAG_NAME, "button").click()
    assert names() == ["near", "far"]
    assert seen.get_attribute("aria-sort") == "descending"
    seen.find_element(By.TAG_NAME, "button").click()
    assert names() == ["far", "near"]
    page.find_element(By.LINK_TEXT, "far").click()
    WebDriverWait(page, 10).until(lambda page: asked(page, "followed") == "far")
    assert asked(page, "step") == GIVEN_UP


@pytest.fixture(scope="module")
def beside_the_road(tmp_path_factory) -> str:
    """Return the page of the scene in which *near* drives 30 m to the right of the main lanes."""
    folder = write_recorded_scene(tmp_path_factory.mktemp("ramp") / "run")
    truth = pd.read_parquet(folder / "truth.parquet")
    truth.loc[truth["vehicle_id"] == "near", "lat_m"] = -30.0
    rewrite(folder, "truth.parquet", truth)
    return write_run_page(folder).as_uri()


def test_the_camera_follows_a_vehicle_off_the_main_lanes_whose_ramp_is_drawn(browser, beside_the_road):
    browser.set_window_size(*DESK)
    browser.get("about:blank")
    browser.get(f"{beside_the_road}#t=1&vehicle=ego")
    assert "near" not in asked(browser, "positions")
    Select(browser.find_element(By.ID, "follow")).select_by_visible_text("near")
    assert "near" in asked(browser, "positions")
    data = "JSON.parse(document.getElementById('replay-data').textContent)"
    assert len(browser.execute_script(f"return {data}.road.ramps")) == 1


def test_any_column_of_a_vehicle_or_its_track_can_be_plotted(page):
    Select(page.find_element(By.ID, "follow")).select_by_visible_text("far")
    plot = Select(page.find_element(By.ID, "plot"))
    names = [option.text for option in plot.options]
    assert {"vehicle: accel_mps2", "its track: speed_mps", "its track: existence"} <= set(names)
    drawn = set()
    for name in names:
        plot.select_by_visible_text(name)
        drawn.add(page.execute_script("return document.getElementById('chart').toDataURL()"))
    assert len(drawn) == len(names)
    assert page.get_log("browser") == []


def test_the_slider_the_bars_and_the_chart_have_one_axis_of_time_and_a_gap_has_its_reason(page):
    Select(page.find_element(By.ID, "follow")).select_by_visible_text("far")
    edges = "(id => { const r = document.getElementById(id).getBoundingClientRect(); return [r.left, r.right]; })"
    slider, bars, chart = (page.execute_script(f"return {edges}('{name}')") for name in ("scrub", "timeline", "chart"))
    assert bars == chart == [slider[0] + 8, slider[1] - 8], "half of the slider's thumb stands out on each side"
    for name in ("timeline", "chart"):
        box = page.find_element(By.ID, name)
        ActionChains(page).move_to_element_with_offset(box, round(box.size["width"] / 4), 0).click().perform()
        assert asked(page, "step") == pytest.approx(0.75 * (STEPS - 1), abs=0.6)
    assert asked(page, "gaps") == [{"gap": "no track", "begin": GIVEN_UP, "end": NEW_TRACK - 1}]
