"""What only OpenEMS does, as its source says, and what else may answer at that port."""

import socketserver
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from plant_partners import Behaviour, Connecting, Watched, server

from bess.edge.plant_io import LinkError, calls, openems
from bess.edge.plant_io.simulated_openems import SimulatedEdge

ASKED = np.array([40.0, -30.0, 92.0])


@pytest.fixture
def edge(watched: Watched) -> Iterator[SimulatedEdge]:
    with SimulatedEdge(watched.plant) as edge:
        yield edge


def _without_password(edge: SimulatedEdge) -> str:
    return edge.address.replace("x:owner@", "")


def test_a_write_to_one_string_keeps_those_of_all_others_alive(edge: SimulatedEdge, watched: Watched) -> None:
    edge.write(0, 10_000.0)
    watched.clock.now_s += 40.0
    edge.write(1, 20_000.0)
    watched.clock.now_s += 40.0
    assert watched.power_kw() == pytest.approx([10.0, 20.0, 0.0])
    watched.clock.now_s += 21.0
    assert watched.power_kw().tolist() == [0.0, 0.0, 0.0]


def test_a_set_point_that_cannot_be_taken_back_lapses_before_the_others_go_on(
    connecting: Connecting, edge: SimulatedEdge, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "CLOCK", watched.clock)
    link = connecting(edge.address)
    link.write(ASKED)
    watched.plant.faults.silent.add(0)
    others = np.array([np.nan, *ASKED[1:]])
    outcomes = []
    for _ in range(12):
        watched.clock.now_s += 10.0
        try:
            link.write(others)
        except LinkError as error:
            assert "ess0 may still have a set-point that cannot be changed" in str(error)
            outcomes.append("waits")
        else:
            outcomes.append("written")
    assert outcomes == ["written"] * 2 + ["waits"] * 6 + ["written"] * 4
    assert watched.power_kw() == pytest.approx([0.0, *ASKED[1:]], abs=0.01)


def test_a_string_that_refuses_but_holds_nothing_stops_nobody(
    connecting: Connecting, edge: SimulatedEdge, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "CLOCK", watched.clock)
    link = connecting(edge.address)
    link.write(np.array([np.nan, *ASKED[1:]]))
    watched.plant.faults.silent.add(0)
    for _ in range(30):
        watched.clock.now_s += 10.0
        link.write(np.array([np.nan, *ASKED[1:]]))
        assert watched.power_kw() == pytest.approx([0.0, *ASKED[1:]], abs=0.01)


def test_a_wrong_password_is_said_to_be_one(
    connecting: Connecting, edge: SimulatedEdge, watched: Watched
) -> None:
    link = connecting(edge.address.replace("owner", "guess"))
    for attempt in (link.read, lambda: link.write(ASKED)):
        with pytest.raises(LinkError, match=r"refuses user and password.*BESS_PLANT_PASSWORD") as caught:
            attempt()
        assert "guess" not in str(caught.value)
    assert watched.asked == []


def test_the_password_may_come_from_the_environment(
    connecting: Connecting, edge: SimulatedEdge, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LinkError, match="refuses user and password"):
        connecting(_without_password(edge)).read()
    monkeypatch.setenv("BESS_PLANT_PASSWORD", "owner")
    assert connecting(_without_password(edge)).read().available.all()


def test_more_batteries_than_strings_must_be_named(connecting: Connecting, edge: SimulatedEdge) -> None:
    with pytest.raises(LinkError, match=r"has ess0, ess1, ess2, the study 2 strings; name the strings with"):
        connecting(edge.address, 2).read()
    assert connecting(f"{edge.address}?ess=ess1,ess2", 2).read().soc.shape == (2,)


def test_a_component_that_there_is_not_is_a_string_that_is_out_of_service(
    connecting: Connecting, edge: SimulatedEdge
) -> None:
    said = connecting(f"{edge.address}?ess=ess0,ess7", 2).read()
    assert said.available.tolist() == [True, False]
    assert said.remarks == ("", "the edge reports no value of ess7/Soc, ess7/ActivePower")
    with pytest.raises(LinkError, match="has none of ess7, ess8"):
        connecting(f"{edge.address}?ess=ess7,ess8", 2).read()


def test_a_meter_of_the_plant_is_read_if_it_is_named(
    connecting: Connecting, edge: SimulatedEdge, watched: Watched
) -> None:
    link = connecting(f"{edge.address}?ess=ess0,ess1,ess2&meter=meter0")
    link.write(np.array([40.0, 30.0, 0.0]))
    watched.clock.now_s += 2.0
    watched.plant.faults.silent.add(1)
    assert link.read().plant_kw == pytest.approx(70.0, abs=0.5)


def test_a_meter_that_there_is_not_is_refused_at_the_start_only(
    connecting: Connecting, edge: SimulatedEdge, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LinkError, match=r"meter9 has no ActivePower; correct or omit \?meter="):
        connecting(f"{edge.address}?meter=meter9").read()
    link = connecting(f"{edge.address}?meter=meter0")
    link.read()
    rows = [row for row in edge.channels() if not row["address"].startswith("meter0")]
    monkeypatch.setattr(edge, "channels", lambda: rows)
    said = link.read()
    assert said.available.all() and np.isnan(said.plant_kw)


def test_ten_batteries_are_in_the_order_of_their_numbers(
    connecting: Connecting, edge: SimulatedEdge, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [
        {**row, "address": f"ess{10 - 5 * int(row['address'][3])}/{row['address'].split('/')[1]}"}
        for row in edge.channels()
        if row["address"].startswith("ess")
    ]
    for row in rows:
        if row["address"].endswith("/Soc"):
            row["value"] = int(row["address"][3:].split("/")[0])
    monkeypatch.setattr(edge, "channels", lambda: rows)
    assert connecting(edge.address).read().soc == pytest.approx([0.0, 0.05, 0.10])


@pytest.mark.parametrize("value", ["50", True, None, [50], float("nan"), 10**400])
def test_what_is_no_number_is_unknown(
    connecting: Connecting, edge: SimulatedEdge, monkeypatch: pytest.MonkeyPatch, value: object
) -> None:
    rows = edge.channels()
    next(row for row in rows if row["address"] == "ess1/Soc")["value"] = value
    monkeypatch.setattr(edge, "channels", lambda: rows)
    said = connecting(edge.address).read()
    assert np.isnan(said.soc[1])
    assert said.available.tolist() == [True, False, True]


def test_a_limit_that_is_not_said_is_none_and_one_that_is_unknown_is_zero(
    connecting: Connecting, edge: SimulatedEdge, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [row for row in edge.channels() if row["address"] != "ess0/AllowedChargePower"]
    next(row for row in rows if row["address"] == "ess1/AllowedChargePower")["value"] = None
    next(row for row in rows if row["address"] == "ess2/AllowedChargePower")["value"] = 5000  # forced to give
    monkeypatch.setattr(edge, "channels", lambda: rows)
    said = connecting(edge.address).read()
    assert said.charge_limit_kw.tolist() == [np.inf, 0.0, 0.0]
    assert said.available.tolist() == [True, False, True]


def test_a_plant_off_the_grid_is_not_driven(
    connecting: Connecting, edge: SimulatedEdge, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = edge.channels()
    next(row for row in rows if row["address"] == "ess0/GridMode")["value"] = 2
    monkeypatch.setattr(edge, "channels", lambda: rows)
    assert connecting(edge.address).read().available.tolist() == [False, True, True]


def _answering(answer: bytes) -> Behaviour:
    def behave(request: socketserver.StreamRequestHandler, stop: threading.Event) -> None:
        request.rfile.readline()
        request.wfile.write(answer)

    return behave


def _address(port: int) -> str:
    return f"openems=http://x:owner@127.0.0.1:{port}"


def _http(body: bytes, status: str = "200 OK") -> bytes:
    return b"HTTP/1.1 %s\r\nContent-Length: %d\r\n\r\n%s" % (status.encode(), len(body), body)


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\xff\xfe nonsense\r\n\r\n",
        _http(b"<html>a web server</html>"),
        _http(b"[1, 2, 3]"),
        _http(b'[{"address": 5}]'),
        _http(b'"text"'),
        _http(b"[" * 100_000),
        _http(b"\xff\xfe"),
        _http(b"moved", "302 Found\r\nLocation: http://127.0.0.1:9/"),
        _http(b"", "503 Service Unavailable"),
        b"HTTP/1.1 200 OK\r\nContent-Length: 1000\r\n\r\n[",
    ],
    ids=str,
)
def test_what_is_no_edge_is_an_error_in_one_sentence(connecting: Connecting, answer: bytes) -> None:
    with server(_answering(answer)) as port:
        link = connecting(_address(port))
        with pytest.raises(LinkError) as caught:
            link.read()
        assert "\n" not in str(caught.value)
        assert "owner" not in str(caught.value)


def test_an_answer_that_never_ends_is_cut_off_in_time(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "DEADLINE_S", 0.3)

    def drip(request: socketserver.StreamRequestHandler, stop: threading.Event) -> None:
        request.rfile.readline()
        request.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 1000000\r\n\r\n[")
        while not stop.wait(0.05):
            request.wfile.write(b" ")

    with server(drip) as port:
        link = connecting(_address(port))
        with pytest.raises(LinkError, match=r"no answer within 0.3 s"):
            link.read()


def test_an_answer_that_is_too_long_is_cut_off(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(openems, "_MAX_ANSWER", 1000)
    with server(_answering(_http(b" " * 5000))) as port:
        link = connecting(_address(port))
        with pytest.raises(LinkError, match="more than 1000 bytes"):
            link.read()
