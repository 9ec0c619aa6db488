"""Links to plants over OpenEMS and SunSpec, and simulated counterparts."""

from __future__ import annotations

from importlib import import_module

from bess.edge.plant_io.address import parse_address
from bess.edge.plant_io.link import LinkError, Measurements, PlantLink
from bess.optional_dependencies import extra

__all__ = ["LinkError", "Measurements", "PlantLink", "connect"]


def connect(text: str, n_strings: int) -> PlantLink:
    """Return the link to a plant; nothing is sent before its first use.

    Parameters
    ----------
    text
        ``openems=URL`` or ``sunspec=HOST[:PORT]``; ``?ess=ess1,ess2`` or ``?unit=1,2`` names the strings in
        their order. The default is all ``essN`` of the plant in numerical order, or units 1, 2, ...
        ``meter=meter1`` names an OpenEMS meter of all strings, positive = discharge.
    n_strings
        Number of strings of the controller.

    Raises
    ------
    InputError
        The address is invalid or has another number of strings, or the extra ``plant`` is missing.
    """
    address = parse_address(text)
    with extra("plant", f"a plant behind {address.kind}"):
        module = import_module(f"bess.edge.plant_io.{address.kind}")
    link: PlantLink = module.Link(address, n_strings)
    return link
