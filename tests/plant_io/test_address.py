"""The address of a plant: what is taken, and what is said about a typo."""

import pytest

from bess.edge.plant_io.address import parse_address
from bess.errors import InputError


def test_an_openems_edge_is_a_url() -> None:
    address = parse_address("openems=https://x:secret@edge.example:8443?ess=ess2,ess1")
    assert address.url == "https://edge.example:8443"
    assert (address.user, address.password) == ("x", "secret")
    assert address.strings == ("ess2", "ess1")


def test_ports_that_are_not_named_are_those_of_the_protocol() -> None:
    assert parse_address("openems=http://10.0.0.5").port == 8084
    assert parse_address("sunspec=10.0.0.5").url == "tcp://10.0.0.5:502"
    assert parse_address("sunspec=[::1]:1502").url == "tcp://[::1]:1502"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "openems",
        "openems=",
        "openmes=http://127.0.0.1:8084",
        "openems=ftp://127.0.0.1",
        "openems=http://",
        "openems=http://127.0.0.1:99999",
        "openems=http://127.0.0.1:0",
        "openems=http://127.0.0.1:port",
        "openems=http://127.0.0.1/rest",
        "openems=http://[::1",
        "openems=http://a..b",
        "openems=http://127.0.0.1?ess=",
        "openems=http://127.0.0.1?ess=ess0,ess0",
        "openems=http://127.0.0.1?unit=1",
        "sunspec=http://127.0.0.1",
        "sunspec=127.0.0.1?ess=1",
        "sunspec=a..b",
        "sunspec=user:word@127.0.0.1",
    ],
)
def test_a_typo_is_one_sentence_that_shows_how_to_write_it(text: str) -> None:
    with pytest.raises(InputError, match=r"(expected|write it as in|only) "):
        parse_address(text)


@pytest.mark.parametrize("address", ["http://user:{}@127.0.0.1:8084/rest", "user:{}@127.0.0.1/rest"])
@pytest.mark.parametrize("password", ["secret", "sec//ret", "//secret", "sec@ret", "sec:ret"])
def test_a_message_never_shows_a_password(address: str, password: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_address("openems=" + address.format(password))
    assert "sec" not in str(caught.value) and "ret" not in str(caught.value)
    assert "user" in str(caught.value)
