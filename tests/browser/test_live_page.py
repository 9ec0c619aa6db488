"""The live page of the service in a real browser: it shows the strings, quietly, behind its token too."""

from __future__ import annotations

import socket
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
from live_cases import measured

from bess.serve.app import Driven, build_app
from bess.serve.connections import Connection
from bess.serve.service import Service
from bess.study import load_study

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
        answer = made.answer(measured(soc, [25.0, 30.0, 53.0]), 180.0 * np.sin(k / 60.0))
        soc = soc - answer.request_kw / 266.0 / 60.0
    yield made
    made.close()


def served(service: Service, token: str | None, driven: Driven | None = None) -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
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
    assert [length > 1000 for length in browser.execute_script(paths, "#power path")] == 4 * [True]
    assert [length > 1000 for length in browser.execute_script(paths, "#soc path")] == 3 * [True]
    script = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    wide, visible = browser.execute_script(script)
    assert wide <= visible
    assert [line for line in browser.get_log("browser") if line["level"] != "INFO"] == []


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
