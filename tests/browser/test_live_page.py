"""The live page of the service in a real browser: it shows the strings, quietly, behind its token too."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("uvicorn")
pytest.importorskip("fastapi")

import uvicorn

sys.path.append(str(Path(__file__).parents[1] / "serve"))
sys.path.append(str(Path(__file__).parents[2] / "benches"))
from live_cases import measured

from bess.edge.serve.answer import Demand
from bess.edge.serve.app import build_app
from bess.edge.serve.control_loop import ControlLoop
from bess.edge.serve.gate import Connection
from bess.edge.serve.service import Service
from bess.study import load_study
from service_load import free_port

pytestmark = pytest.mark.browser

WIDTHS = (1400, 420)
TOKEN = "0123456789abcdef0123456789abcdef"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service of three strings with some hours behind it, one of them hot."""
    values = {"system.n_strings": 3, "policy.name": "mpc", "service.control_step_s": 60.0}
    made = Service(load_study("policies", values), tmp_path_factory.mktemp("live"))
    soc = np.array([0.6, 0.5, 0.55])
    now_s = made.clock()
    for k in range(600):
        made.clock = lambda k=k: now_s - 36_000.0 + 60.0 * k  # type: ignore[assignment,misc]
        answer = made.answer(measured(soc, [25.0, 30.0, 53.0]), Demand(180.0 * np.sin(k / 60.0)))
        soc = soc - answer.request_kw / 266.0 / 60.0
    yield made
    made.close()


def served(service: Service, token: str | None, driven: ControlLoop | None = None) -> Iterator[str]:
    port = free_port()
    app = build_app(service, token, driven)
    config = uvicorn.Config(app, http=Connection, port=port, log_config=None, ws="none")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.02)
    yield f"http://127.0.0.1:{port}/"
    server.should_exit = True
    thread.join()


@pytest.fixture
def page(service: Service) -> Iterator[str]:
    yield from served(service, None)


@pytest.fixture
def closed_page(service: Service) -> Iterator[str]:
    yield from served(service, TOKEN)


def overlapping(browser: Any) -> list[str]:
    """Labels of the charts that lie upon each other."""
    script = """
      return [...document.querySelectorAll(".curve svg")].flatMap(svg => {
        const all = [...svg.querySelectorAll("text")].map(text => [text.textContent, text.getBoundingClientRect()]);
        const meet = (p, q) => p.left < q.right && q.left < p.right && p.top + 2 < q.bottom && q.top + 2 < p.bottom;
        return all.flatMap(([a, p], i) => all.slice(i + 1).filter(([, q]) => meet(p, q)).map(([b]) => a + " / " + b));
      });"""  # noqa: E501
    found: list[str] = browser.execute_script(script)
    return found


def opened(browser: Any, page: str, width: int, wanted: str) -> None:
    """Open the page at a width and wait for an element."""
    from selenium.webdriver.support.ui import WebDriverWait

    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get_log("browser")
    browser.get(page)
    WebDriverWait(browser, 20).until(lambda _: browser.find_element("css selector", wanted).is_displayed())


@pytest.mark.parametrize("width", WIDTHS)
def test_strings_set_points_reasons_and_curves_are_shown(
    browser: Any, page: str, width: int, service: Service
) -> None:
    opened(browser, page, width, ".string p")
    strings = browser.find_elements("css selector", ".string")
    assert len(strings) == 3
    assert service.last is not None
    for i, string in enumerate(strings):
        assert f"string {i}" in string.text
        assert service.last[2].reasons[i] in string.text
        assert " kW" in string.text
    paths = "return [...document.querySelectorAll(arguments[0])].map(p => p.getAttribute('d').length)"
    assert [length > 1000 for length in browser.execute_script(paths, "#string-power path")] == 3 * [True]
    assert [length > 1000 for length in browser.execute_script(paths, "#soc path")] == 3 * [True]
    names = texts(browser, "#power-key")[0]
    assert "foreseen an hour before" in names
    assert "demand ahead, as on the day before" in names
    script = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    wide, visible = browser.execute_script(script)
    assert wide <= visible
    assert [line for line in browser.get_log("browser") if line["level"] != "INFO"] == []


def texts(browser: Any, selector: str) -> list[str]:
    """Texts of all elements in one call, as the page may replace them between two."""
    script = "return Array.from(document.querySelectorAll(arguments[0]), e => e.innerText || e.textContent)"
    return list(browser.execute_script(script, selector))


@pytest.mark.parametrize("width", WIDTHS)
def test_many_strings_are_ranges_and_the_outermost_by_name(browser: Any, width: int, tmp_path: Path) -> None:
    n = 64
    made = Service(load_study("policies", {"system.n_strings": n, "policy.name": "soc"}), tmp_path)
    soc, temperature_c, fit = np.linspace(0.3, 0.8, n), np.full(n, 25.0), np.arange(n) != 7
    temperature_c[20] = 51.0
    made.answer(measured(soc, temperature_c, available=fit), Demand(900.0))
    for page in served(made, None):
        opened(browser, page, width, ".string p")
        cards = texts(browser, ".string")
        assert len(browser.find_elements("css selector", ".tiles i")) == n
        assert len(cards) < 12
        for named, why in ((7, "out of service"), (20, "hottest"), (0, "emptiest"), (n - 1, "fullest")):
            assert any(f"string {named} " in card and why in card for card in cards), (named, cards)
        said = texts(browser, "#because")[0]
        assert "out of service, says the plant – string 7 rests" in said
        assert "left to discharge" in texts(browser, "#plant")[0].lower()
        assert overlapping(browser) == []
        wide, visible = browser.execute_script(
            "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        )
        assert wide <= visible
        assert [line for line in browser.get_log("browser") if line["level"] != "INFO"] == []
    made.close()


@pytest.mark.parametrize("ago_s", [60.0, 86_400.0, 7 * 86_400.0])
@pytest.mark.parametrize("width", WIDTHS)
def test_the_axes_fit_a_minute_a_day_a_week(browser: Any, width: int, ago_s: float, tmp_path: Path) -> None:
    made = Service(load_study("policies", {"system.n_strings": 2, "policy.name": "soc"}), tmp_path)
    now_s = made.clock()
    for at_s in np.linspace(now_s - ago_s, now_s, 300):
        made.clock = lambda at_s=at_s: at_s  # type: ignore[assignment,misc]
        made.answer(measured([0.5, 0.5]), Demand(50.0))
    for page in served(made, None):
        opened(browser, page, width, ".string p")
        for button in browser.find_elements("css selector", "#spans button"):
            button.click()
            time.sleep(0.3)
            assert overlapping(browser) == []
            labels = texts(browser, "#soc text")
            assert sum(":" in label or label[:3].isalpha() for label in labels) >= 2, labels
    made.close()


def test_the_page_asks_for_the_token(browser: Any, closed_page: str) -> None:
    opened(browser, closed_page, 1400, "#token")
    field = browser.find_element("id", "token")
    field.send_keys("wrong\n")
    from selenium.webdriver.support.ui import WebDriverWait

    said = browser.find_element("id", "wrong")
    WebDriverWait(browser, 10).until(lambda _: "not the right one" in said.text)
    assert not browser.find_elements("css selector", ".string")
    field.send_keys(TOKEN + "\n")
    WebDriverWait(browser, 10).until(lambda _: browser.find_elements("css selector", ".string p"))
