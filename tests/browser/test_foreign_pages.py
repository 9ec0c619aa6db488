"""Pages of other origins in a real browser: whatever they send, the plant does not move."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("uvicorn")
pytest.importorskip("fastapi")

from test_live_page import served

from bess.edge.plant_io.journal import Journal
from bess.edge.serve.control_loop import ControlLoop, Demands
from bess.edge.serve.service import Service
from bess.study import load_study

pytestmark = pytest.mark.browser

BODY = {"demand_kw": -180.0, "valid_for_s": 86_400}
PAGE = """<!doctype html><title>elsewhere</title>
<form id="form" method="post" enctype="text/plain" target="answer" action="URL">
<input name='{"demand_kw": -180.0, "valid_for_s": 86400, "x": "' value='"}'></form>
<iframe name="answer" id="answer"></iframe><img id="image">"""
SEND = """
const [url, body, done] = arguments;
const blob = kind => new Blob([body], {type: kind});
const end = answer => answer.type + " " + answer.status, failed = error => "failed";
Promise.all([
  fetch(url, {method: "POST", mode: "no-cors", body}).then(end, failed),
  fetch(url, {method: "POST", mode: "no-cors", body: blob("application/json")}).then(end, failed),
  fetch(url, {method: "POST", mode: "no-cors", keepalive: true, body}).then(end, failed),
  fetch(url, {method: "POST", headers: {"Content-Type": "application/json"}, body}).then(end, failed),
  fetch(url.replace("demand", "live")).then(end, failed),
  fetch(url.replace("demand", "calibration"), {method: "DELETE"}).then(end, failed),
  navigator.sendBeacon(url, blob("text/plain")),
  new Promise(load => {
    document.getElementById("answer").onload = () => load("answered");
    document.getElementById("form").submit();
  }),
]).then(done);
"""
ASK = """
const [body, done] = arguments;
fetch("/v1/demand", {method: "POST", headers: {"Content-Type": "application/json"}, body})
  .then(answer => done(answer.status));
"""


class NoLink:
    """A plant that is never reached."""


@pytest.fixture
def demands(tmp_path: Path) -> Iterator[tuple[Demands, str]]:
    """The demands of a service that drives a plant without a token, and the address of its page."""
    study = load_study("policies", {"policy.name": "mpc", "policy.foresight_h": 2.0, "demand.repeat": False})
    service = Service(study, tmp_path / "state")
    demands = Demands(study, 900.0)
    journal = Journal(tmp_path / "state", service.controller.system, "test")
    driven = ControlLoop(service, NoLink(), demands, journal, address="a plant")  # type: ignore[arg-type]
    for page in served(service, None, driven):
        yield demands, page
    service.close()


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[Path]:
    """A folder that is served at another origin: the file ``port`` in it says which."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None: ...

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        (folder / "port").write_text(str(server.server_port))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield folder
        server.shutdown()


def asked_kw(demands: Demands) -> Any:
    return demands._posted and demands._posted[0]


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_a_page_of_another_origin_does_not_move_the_plant(
    browser: Any, demands: tuple[Demands, str], elsewhere: Path, name: str
) -> None:
    posted, page = demands
    url = page + "v1/demand"
    (elsewhere / "index.html").write_text(PAGE.replace("URL", url))
    browser.get(f"http://{name}:{(elsewhere / 'port').read_text()}/")
    browser.set_script_timeout(20)
    got = browser.execute_async_script(SEND, url, json.dumps(BODY))
    assert len(got) == 8
    assert asked_kw(posted) is None
    # Nothing can be read either: only what the browser keeps from the page comes back.
    assert set(got[:6]) <= {"opaque 0", "failed"}
    assert got[4] == "failed"


def test_a_name_that_is_pointed_here_for_a_moment_is_refused(
    browser: Any, demands: tuple[Demands, str]
) -> None:
    posted, page = demands
    browser.get(page.replace("127.0.0.1", "rebound.test") + "v1/live")
    assert "--allowed-host" in browser.page_source
    assert '"history"' not in browser.page_source
    assert browser.execute_async_script(ASK, json.dumps(BODY)) == 421
    assert asked_kw(posted) is None


def test_the_page_of_the_service_itself_may_ask(browser: Any, demands: tuple[Demands, str]) -> None:
    posted, page = demands
    for own in (page, page.replace("127.0.0.1", "localhost")):
        browser.get(own)
        assert browser.execute_async_script(ASK, json.dumps(BODY)) == 200
        assert asked_kw(posted) == -180.0
        posted.post(0.0, 1.0, 0.0)


def test_a_link_on_another_page_opens_the_page_of_the_service(
    browser: Any, demands: tuple[Demands, str], elsewhere: Path
) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    (elsewhere / "index.html").write_text(f'<!doctype html><a href="{demands[1]}">the plant</a>')
    browser.get(f"http://localhost:{(elsewhere / 'port').read_text()}/")
    browser.find_element("css selector", "a").click()
    WebDriverWait(browser, 20).until(lambda _: browser.title == "policies · bess serve")
