"""Claims about the page in a real browser: it draws, quietly, at the width of a desk and of a telephone."""

import re
import sys
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

sys.path.append(str(Path(__file__).parents[1] / "report"))
from folders import write_run
from synthetic import record

from bess.report import write_report

pytestmark = pytest.mark.browser

WIDTHS = (1400, 420)
CHARTS = 3
"""Interactive figures of two scenarios side by side."""
SVG = "data:image/svg+xml,<?xml"
DRAWN = """
const within = (root) => [...root.querySelectorAll("*")].filter((element) => element.shadowRoot);
const panels = (root) => within(root).flatMap(({ shadowRoot }) => [
  ...shadowRoot.querySelectorAll("canvas"), ...panels(shadowRoot),
]);
return panels(arguments[0]).filter((canvas) => canvas.width > 100 && canvas.height > 50).length;
"""


@pytest.fixture(scope="module")
def scenarios(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("browser") / "scenarios"
    for name, share in (("S1", 1.0), ("S3", 0.0)):
        write_run(directory / name, record(2, 96, concentrate=share, nodes=8), name)
    return write_report(directory)


@pytest.fixture(scope="module")
def year(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(
        write_run(tmp_path_factory.mktemp("browser") / "year", record(10, 35_040, price=True))
    )


def opened(browser: Any, page: Path, width: int, height: int = 900) -> list[Any]:
    """Open the page at a size, scroll through it until every figure is drawn, and return its charts.

    Then it shows its top, where the bar of links lies on nothing.
    """
    from selenium.webdriver.support.ui import WebDriverWait

    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get_log("browser")
    browser.get(page.as_uri())
    wait = WebDriverWait(browser, 60)
    # With a busy processor a page is there before its parts.
    wait.until(lambda _: browser.execute_script("return document.readyState") == "complete")
    charts = wait.until(lambda _: browser.find_elements("css selector", ".chart"))
    for chart in charts:
        browser.execute_script("arguments[0].closest('figure').scrollIntoView()", chart)
        wait.until(lambda _, chart=chart: browser.execute_script(DRAWN, chart))
    browser.execute_script("scrollTo(0, 0)")
    return charts


def complaints(browser: Any) -> list[str]:
    """What the page said on the console; the library's news of being idle are none."""
    return [line["message"] for line in browser.get_log("browser") if line["level"] != "INFO"]


@pytest.mark.parametrize("width", WIDTHS)
def test_every_figure_is_drawn_without_a_complaint(browser: Any, scenarios: Path, width: int) -> None:
    charts = opened(browser, scenarios, width)
    assert len(charts) == CHARTS
    assert all(chart.size["height"] > 150 for chart in charts)
    assert complaints(browser) == []


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_makes_the_page_scroll_sideways(
    browser: Any, scenarios: Path, year: Path, width: int
) -> None:
    for page in (scenarios, scenarios.parent / "S1" / "report.html", year):
        opened(browser, page, width)
        script = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        wide, visible = browser.execute_script(script)
        assert wide <= visible


LABELS = """
const out = [];
const boxes = [...document.querySelectorAll(arguments[0])].filter((e) => e.offsetParent).map((e) => {
  const box = e.getBoundingClientRect();
  return [e.textContent.trim().slice(0, 40), box.left, box.top, box.right, box.bottom];
});
for (const [i, a] of boxes.entries()) for (const b of boxes.slice(i + 1))
  if (a[1] < b[3] - 1 && b[1] < a[3] - 1 && a[2] < b[4] - 1 && b[2] < a[4] - 1) out.push(a[0] + " | " + b[0]);
return out;
"""


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_text_lies_on_another_and_all_of_it_can_be_read(
    browser: Any, scenarios: Path, width: int, scheme: str
) -> None:
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    try:
        opened(browser, scenarios.parent / "S1" / "report.html", width)
        texts = "nav a, .lead, .tiles dt, .tiles strong, .tiles small, h3, .halves li, .halves p, figcaption"
        assert browser.execute_script(LABELS, texts) == []
        colours = browser.execute_script(
            "const style = getComputedStyle(document.body); return [style.color, style.backgroundColor]"
        )
        ink, paper = (sum(map(int, re.findall(r"\d+", colour)[:3])) / 3 for colour in colours)
        assert abs(ink - paper) > 150 and (paper > ink) == (scheme == "light")
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_links_lead_to_their_sections_and_pictures_load(browser: Any, scenarios: Path) -> None:
    opened(browser, scenarios, 1400)
    for link in browser.find_elements("css selector", "nav a"):
        link.click()
        target = browser.current_url.rpartition("#")[2]
        assert browser.find_element("id", target).is_displayed()
        assert browser.execute_script("return document.querySelector('nav').getBoundingClientRect().top") >= 0
    widths = browser.execute_script(
        "return [...document.querySelectorAll('.still img')].map(i => i.naturalWidth)"
    )
    assert len(widths) > CHARTS and min(widths) > 100
    saved = browser.execute_script(
        "return [...document.querySelectorAll('.save')].map(a => [a.download, a.href])"
    )
    assert all(name.endswith(".svg") and unquote(href).startswith(SVG) for name, href in saved)


def test_a_scenario_is_one_click_away_and_leads_back(browser: Any, scenarios: Path) -> None:
    opened(browser, scenarios, 1400)
    link = browser.find_element("link text", "S3")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", link)
    link.click()
    assert browser.find_element("css selector", "h1").text == "S3"
    browser.find_element("css selector", ".kind a").click()
    assert browser.current_url == scenarios.as_uri()


SHOWN = """
const [figure, label] = arguments;
const view = Bokeh.index.roots.find((view) => figure.contains(view.el));
return [...view.model.document.all_models].filter((model) => model.name === label && model.visible).length;
"""


def test_an_entry_of_the_legend_hides_what_it_names_in_its_own_figure(browser: Any, scenarios: Path) -> None:
    for chart in opened(browser, scenarios, 1400, height=9000):  # draws all figures at once
        figure = chart.find_element("xpath", "ancestor::figure")
        button = figure.find_element("css selector", ".legend button")
        assert button.text == "S1" and browser.execute_script(SHOWN, figure, "S1") > 0
        browser.execute_script("arguments[0].click()", button)
        assert browser.execute_script(SHOWN, figure, "S1") == 0
        assert button.get_attribute("aria-pressed") == "false"


def test_print_shows_the_still_pictures_instead(browser: Any, scenarios: Path) -> None:
    opened(browser, scenarios, 1400)
    shown = (
        "return [...document.querySelectorAll(arguments[0])]"
        ".filter(e => getComputedStyle(e).display != 'none').length"
    )
    stills = browser.execute_script(shown, ".still")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert browser.execute_script(shown, ".chart") == browser.execute_script(shown, "nav") == 0
        assert browser.execute_script(shown, ".still") == stills + CHARTS
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_a_year_of_ten_strings_is_drawn_and_stays_below_two_megabytes(browser: Any, year: Path) -> None:
    opened(browser, year, 420)
    assert complaints(browser) == []
    assert year.stat().st_size < 2e6
