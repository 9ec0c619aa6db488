"""SunSpec's models as registers, and back: their points by pysunspec2's definitions, scaled by hand.

pysunspec2 returns a value unscaled where a device leaves the scale factor out. Here that is an error, since
it would be a power wrong by powers of ten.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

from sunspec2.device import Model

from bess.edge.plant_io.link import LinkError

MARK: Final = (0x5375, 0x6E53)
"""``SunS``, at the first register."""
BASES: Final = (40_000, 0, 50_000)
END: Final = 0xFFFF

_SCALES: Final = range(-10, 11)
_NO_GROUPS: Final = {"NStr": 0}
"""How many strings of a bank follow model 803."""


def to_bytes(registers: Sequence[int]) -> bytes:
    """Return registers as bytes, the high one first."""
    return struct.pack(f">{len(registers)}H", *registers)


def to_registers(data: bytes) -> list[int]:
    """Return bytes as registers."""
    return list(struct.unpack(f">{len(data) // 2}H", data))


def decode(model_id: int, registers: Sequence[int]) -> Any:
    """Return a model with the values of its registers, ID and length included; repeated groups are left out.

    Points behind the last register are not implemented, as those of a device with an older definition.
    """
    model = Model(model_id, data=_NO_GROUPS)
    data = to_bytes(registers)
    for point in model.points.values():
        point.set_mb(data[2 * point.offset :])
    return model


def encode(model_id: int, values: Mapping[str, Any]) -> list[int]:
    """Return a model's registers; values are unscaled, points without one are "not implemented"."""
    model = Model(model_id, data=dict(values))
    model.points["ID"].value = model_id
    model.points["L"].value = model.len - 2
    return to_registers(model.get_mb())


def value(model: Any, name: str) -> float:
    """Return a point in the units of its model; NaN where the device does not implement it.

    Raises
    ------
    LinkError
        If the point is there and its scale factor is not.
    """
    point = model.points[name]
    if point.value is None:
        return math.nan
    return float(point.value) * 10.0 ** scale(model, name)


def scale(model: Any, name: str) -> int:
    """Return the power of ten that a point is scaled by.

    Raises
    ------
    LinkError
        If the device does not say.
    """
    point = model.points[name]
    if not point.sf_required:
        return 0
    factor = point.sf_value if point.sf is None else model.points[point.sf].value
    if factor not in _SCALES:
        raise LinkError(
            f"model {model.model_id} gives {name} with scale factor {point.sf} = {factor}; "
            "nothing is read or written until this is put right"
        )
    return int(factor)


def registers_of(model: Any, name: str, content: int) -> list[int]:
    """Return the registers of one point with an unscaled value."""
    point = model.points[name]
    return to_registers(point.info.to_data(content, 2 * point.len))


def offset(model_id: int, name: str) -> int:
    """Return where a point begins, in registers from the beginning of its model."""
    return int(Model(model_id).points[name].offset)
