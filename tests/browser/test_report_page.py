"""Claims about the page in a real browser: it draws, quietly, at the width of a desk and of a telephone."""

import base64
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.append(str(Path(__file__).parents[1] / "report"))
from folders import write_run
from synthetic import record

from bess.report import write_report

WIDTHS = (1400, 390)
CHARTS = 9
"""Three over both scenarios, three of each."""


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


def opened(browser: Any, page: Path, width: int) -> list[Any]:
    """Open the page at a width, scroll through it until every figure is drawn, and return its charts."""
    from selenium.webdriver.support.ui import WebDriverWait

    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get_log("browser")
    browser.get(page.as_uri())
    charts = browser.find_elements("css selector", ".chart")
    assert charts
    for chart in charts:
        browser.execute_script("arguments[0].closest('figure').scrollIntoView()", chart)
        WebDriverWait(browser, 30).until(
            lambda _, chart=chart: chart.find_elements("css selector", ".main-svg")
        )
    return charts


@pytest.mark.parametrize("width", WIDTHS)
def test_every_figure_is_drawn_without_a_word_on_the_console(
    browser: Any, scenarios: Path, width: int
) -> None:
    charts = opened(browser, scenarios, width)
    assert len(charts) == CHARTS
    for chart in charts:
        traces = chart.find_elements("css selector", ".scatterlayer .trace")
        assert traces and chart.size["height"] > 150
    assert browser.get_log("browser") == []


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_makes_the_page_scroll_sideways(browser: Any, scenarios: Path, width: int) -> None:
    opened(browser, scenarios, width)
    script = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    wide, visible = browser.execute_script(script)
    assert wide <= visible


def test_links_lead_to_their_sections_and_pictures_load(browser: Any, scenarios: Path) -> None:
    opened(browser, scenarios, 1400)
    for link in browser.find_elements("css selector", "nav a"):
        link.click()
        target = browser.current_url.rpartition("#")[2]
        assert browser.find_element("id", target).is_displayed()
    widths = browser.execute_script(
        "return [...document.querySelectorAll('.still img')].map(i => i.naturalWidth)"
    )
    assert len(widths) > CHARTS and min(widths) > 100
    saved = browser.execute_script(
        "return [...document.querySelectorAll('.save')].map(a => [a.download, a.href])"
    )
    assert all(
        name.endswith(".svg") and base64.b64decode(href.partition(",")[2])[:5] == b"<?xml"
        for name, href in saved
    )


def test_print_shows_the_still_pictures_instead(browser: Any, scenarios: Path) -> None:
    opened(browser, scenarios, 1400)
    shown = (
        "return [...document.querySelectorAll(arguments[0])]"
        ".filter(e => getComputedStyle(e).display != 'none').length"
    )
    stills = browser.execute_script(shown, ".still")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert browser.execute_script(shown, ".chart") == 0
        assert browser.execute_script(shown, ".still") == stills + CHARTS
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_a_year_is_drawn_as_well(browser: Any, year: Path) -> None:
    charts = opened(browser, year, 390)
    points = browser.execute_script(
        "return [...document.querySelectorAll('.chart')].map(c => Math.max(...c.data.map(t => t.x.length)))"
    )
    assert len(points) == len(charts) and max(points) <= 4000
    assert browser.get_log("browser") == []


def test_a_script_that_is_not_of_the_page_does_not_run(browser: Any, scenarios: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    strange = "<script>window.strange = 1</script><img src=x onerror='window.strange = 2'></body>"
    page.write_text(scenarios.read_text(encoding="utf-8").replace("</body>", strange), encoding="utf-8")
    opened(browser, page, 1400)
    assert browser.execute_script("return window.strange") is None
    assert any("Content Security Policy" in entry["message"] for entry in browser.get_log("browser"))
