"""Charts in a real browser: drawn offline, told when pointed at, leading to what they are made of."""

import json
from dataclasses import asdict

import pytest

from harness.report.folder_page import write_page
from tests.harness.report.test_charts import REQUEST, grid_table

selenium = pytest.importorskip("selenium", reason="selenium drives the browser")
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

pytestmark = pytest.mark.slow
DOTS = ".chart-place svg .mark-symbol path"


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    folder = tmp_path_factory.mktemp("grid")
    (folder / "grid.json").write_text(json.dumps(asdict(REQUEST)))
    grid_table().to_parquet(folder / "runs.parquet")
    return write_page(folder).as_uri()


@pytest.fixture
def page(browser, address):
    browser.set_window_size(1400, 900)
    browser.get("about:blank")
    browser.get(address)
    WebDriverWait(browser, 30).until(lambda page: page.execute_script("return document.documentElement.dataset.charts"))
    return browser


def test_charts_are_drawn_without_a_complaint_and_nothing_is_fetched(page):
    assert page.execute_script("return document.documentElement.dataset.charts") == "1"
    assert [entry["message"] for entry in page.get_log("browser")] == []
    fetched = "performance.getEntriesByType('resource').map(e => e.name).filter(name => !name.startsWith('data:'))"
    assert page.execute_script(f"return {fetched}") == []


def test_a_point_tells_its_value_and_leads_to_its_runs(page):
    dot = page.find_elements(By.CSS_SELECTOR, DOTS)[-1]
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", dot)
    ActionChains(page).move_to_element(dot).perform()
    tip = WebDriverWait(page, 10).until(lambda page: page.find_element(By.CSS_SELECTOR, "#vg-tooltip-element.visible"))
    assert "stonesoup-jpda" in tip.text
    assert "86.00" in tip.text
    assert page.find_elements(By.CSS_SELECTOR, "details[open]") == []
    ActionChains(page).move_to_element(dot).click().perform()
    (cell,) = WebDriverWait(page, 10).until(lambda page: page.find_elements(By.CSS_SELECTOR, "details[open]"))
    assert cell.find_element(By.TAG_NAME, "summary").text == "stonesoup-jpda, 45 veh/km/lane"
    assert "--seed 0" in cell.text
    assert "--seed 1" in cell.text


def test_a_name_of_the_legend_shows_its_line_alone_and_once_more_all(page):
    button = page.find_element(By.CSS_SELECTOR, "button[data-line]")

    def strengths() -> set[str]:
        found = page.execute_script(
            f"return [...document.querySelectorAll('{DOTS}')].map(e => e.getAttribute('opacity'))"
        )
        return {strength for strength in found if strength != "0"}

    assert strengths() == {"1"}
    button.click()
    WebDriverWait(page, 10).until(lambda _: len(strengths()) == 2)
    assert button.get_attribute("aria-pressed") == "true"
    button.click()
    WebDriverWait(page, 10).until(lambda _: strengths() == {"1"})


@pytest.mark.parametrize("width", [1400, 700, 500])
def test_the_page_is_as_wide_as_the_window_and_tables_scroll_in_their_own_boxes_without_broken_words(page, width):
    page.set_window_size(width, 900)
    fits = "return document.documentElement.scrollWidth <= innerWidth"
    WebDriverWait(page, 10).until(lambda page: page.execute_script(fits))
    for chart in page.find_elements(By.CSS_SELECTOR, ".chart-place svg"):
        assert chart.size["width"] <= width
    told = "const name = document.querySelector('.scroll tbody th'), words = document.createRange();"
    told += "name.textContent = 'first_candidate_of_my_own'; words.selectNodeContents(name);"
    assert page.execute_script(f"{told} return words.getClientRects().length") == 1
