"""Whatever a plant sends, a link returns measurements that hold what they promise, or one error."""

import json
import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from plant_partners import Connecting

from bess.edge.plant_io import LinkError, Measurements
from bess.edge.plant_io.sunspec_device import MARK

CASES = 300
CHANNELS = {
    "Soc": "%",
    "ActivePower": "W",
    "AllowedChargePower": "W",
    "AllowedDischargePower": "W",
    "MinCellTemperature": "°C",
    "State": "",
    "GridMode": "",
    "SetActivePowerEquals": "W",
}


def _holds(said: Measurements) -> None:
    for name in ("soc", "temperature_c", "power_kw", "charge_limit_kw", "discharge_limit_kw", "available"):
        assert getattr(said, name).shape == (2,)
    assert np.isfinite(said.soc[said.available]).all()
    assert np.isfinite(said.power_kw[said.available]).all()
    assert (said.charge_limit_kw >= 0.0).all()
    assert (said.discharge_limit_kw >= 0.0).all()


def _try(link: Any, rng: random.Random) -> list[bool]:
    calls: list[Callable[[], Any]] = [
        lambda: _holds(link.read()),
        lambda: link.write(np.array([rng.uniform(-100.0, 100.0), math.nan])),
        link.release,
    ]
    outcomes = []
    for call in calls:
        try:
            call()
            outcomes.append(True)
        except LinkError as error:
            assert "\n" not in str(error)
            outcomes.append(False)
    return outcomes


def _value(rng: random.Random) -> Any:
    choice = [
        0,
        1,
        50,
        -5,
        1e308,
        10**400,
        None,
        True,
        "x",
        [],
        {},
        math.nan,
        math.inf,
        rng.randint(-(10**6), 10**6),
    ]
    return rng.choice(choice)


def test_openems_with_any_json(connecting: Connecting, monkeypatch: pytest.MonkeyPatch) -> None:
    outcomes = []
    for seed in range(CASES):
        rng = random.Random(seed)
        rows: list[Any] = [
            {
                "address": f"ess{ess}/{name}" if rng.random() < 0.998 else _value(rng),
                "unit": unit if rng.random() < 0.995 else _value(rng),
                "value": _value(rng),
            }
            for ess in range(2)
            for name, unit in CHANNELS.items()
            if rng.random() < 0.97
        ]
        body = json.dumps(rows if rng.random() < 0.98 else _value(rng)).encode()
        body = body if rng.random() < 0.98 else body[: rng.randint(0, len(body))]
        link: Any = connecting("openems=http://127.0.0.1:9", 2)

        async def call(method: str, *_: object, body: bytes = body) -> bytes:
            return body if method == "GET" else b"{}"

        monkeypatch.setattr(link, "_call", call)
        outcomes.append(_try(link, rng))
        link.close()
    assert 0.3 < np.mean(outcomes) < 0.99


class _Device:
    """A Modbus server whose models have any length and hold anything."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._registers = [*MARK]
        lengths = {1: 66, 701: 153, 702: 50, 704: 65, 713: 7, 802: 62, 803: 26}
        for model in [*rng.sample(list(lengths), 3), 701, 704, 713]:
            length = lengths[model] if rng.random() < 0.7 else rng.randint(0, 200)
            small = [0, 1, 2, 0xFFFF, 0xFFFE, 0xFFF6]
            values = [rng.choice(small) if rng.random() < 0.8 else rng.getrandbits(16) for _ in range(length)]
            self._registers += [model, length, *values]
        self._registers += [0xFFFF, 0]

    connected = True

    def close(self) -> None:
        pass

    async def read_holding_registers(self, address: int, *, count: int, device_id: int) -> Any:
        begin = address - 40_000
        known = self._registers[begin : begin + count] if begin >= 0 else []
        short = known[:-1] if self._rng.random() < 0.005 else known
        return _Answer(short, error=len(known) < count)

    async def write_registers(self, address: int, registers: list[int], *, device_id: int) -> Any:
        assert all(0 <= register <= 0xFFFF for register in registers)
        return _Answer([], error=False)


class _Answer:
    def __init__(self, registers: list[int], *, error: bool) -> None:
        self.registers = registers
        self._error = error

    def isError(self) -> bool:  # noqa: N802 - pymodbus' name
        return self._error


def test_sunspec_with_any_registers(connecting: Connecting, monkeypatch: pytest.MonkeyPatch) -> None:
    outcomes = []
    for seed in range(CASES):
        rng = random.Random(seed)
        link: Any = connecting("sunspec=127.0.0.1:9", 2)
        monkeypatch.setattr(link._gateways[0], "_client", _Device(rng))
        outcomes.append(_try(link, rng))
        link.close()
    assert 0.1 < np.mean(outcomes) < 0.99
