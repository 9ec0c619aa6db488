"""Files of a distilled controller: ``policy.json``, C99 and structured text."""

from __future__ import annotations

from bess import __version__
from bess.control.explicit import ExplicitController
from bess.edge.distil.c99 import c_header, c_source
from bess.edge.distil.structured_text import st_source

POLICY = "policy.json"


def constants(controller: ExplicitController) -> dict[str, float | tuple[float, ...]]:
    """What the decision calls by names in capitals: the tables, and the weights."""
    tables = {name.upper(): getattr(controller.tables, name) for name in type(controller.tables).model_fields}
    return {**tables, "WEIGHTS": controller.weights}


def exports(controller: ExplicitController) -> dict[str, str]:
    """Texts by the name of their file."""
    about = (
        f"Power split of {controller.tables.strings} strings ({controller.system}), distilled from study "
        f"{controller.study} by bess {__version__}; kW, positive = discharge."
    )
    values = constants(controller)
    return {
        POLICY: controller.to_json(),
        "split.c": c_source(values, about),
        "split.h": c_header(controller.tables.strings, controller.tables.steps, about),
        "split.st": st_source(values, about),
    }
