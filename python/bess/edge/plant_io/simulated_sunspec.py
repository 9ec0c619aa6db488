"""Simulated SunSpec devices: one Modbus unit for each string of a simulated plant.

Each unit has models 1, 701, 702, 704, 713, 802 and 803 from register 40000. ``WSet`` becomes active when
``WSetEna`` is written, and reverts by itself after ``WSetRvrtTms``.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any, Final

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from bess.edge.plant_io.calls import Calls
from bess.edge.plant_io.simulated import SimulatedPartner, SimulatedPlant
from bess.edge.plant_io.sunspec_device import END, MARK, decode, encode, offset, value

BASE: Final = 40_000
_START_S: Final = 10.0


class SimulatedDevices(SimulatedPartner):
    """Serves a plant as SunSpec devices on the loopback, strings as units 1, 2, ...; a context manager."""

    def __init__(self, plant: SimulatedPlant, *, port: int = 0) -> None:
        super().__init__(plant, port)
        self._calls: Calls | None = None
        self._server: Any = None  # its methods carry no types

    @property
    def address(self) -> str:
        """Address for ``--plant``."""
        return f"sunspec=127.0.0.1:{self._port}"

    def stop(self) -> None:
        """Break all connections, as a gateway that is switched off; plant and watchdog continue."""
        if self._calls is not None:
            self._calls.close(self._server.shutdown())
            self._calls = None

    def _listen(self, port: int) -> int:
        self._calls = Calls()
        return self._calls(self._serve(port), _START_S)

    async def _serve(self, port: int) -> int:
        devices = [_Device(self.plant, string).simulated() for string in range(self.plant.n_strings)]
        self._server = ModbusTcpServer(devices, address=("127.0.0.1", port))
        await self._server.serve_forever(background=True)
        return int(self._server.transport.sockets[0].getsockname()[1])


class _Device:
    """One string's registers."""

    def __init__(self, plant: SimulatedPlant, string: int) -> None:
        self._plant = plant
        self._string = string
        unset = ("WSetEna", "WSet", "WSetRvrt", "WSetEnaRvrt", "WSetRvrtTms")
        self._control = {"WSetMod": 1, **dict.fromkeys(unset, 0)}
        self._controller_beat = 0
        self._place: dict[int, range] = {}
        """Addresses of each model."""

    def simulated(self) -> SimDevice:
        """Return the device for the Modbus server."""
        registers = [*MARK]
        for model_id, values in self._models().items():
            begin = BASE + len(registers)
            registers += encode(model_id, values)
            self._place[model_id] = range(begin, BASE + len(registers))
        simdata = SimData(BASE, values=[*registers, END, 0], datatype=DataType.REGISTERS)
        return SimDevice(self._string + 1, simdata, action=self._act)

    async def _act(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Answer one request: refuse it, accept the written registers, or update the registers."""
        await asyncio.sleep(self._plant.faults.delay_s)
        if self._string in self._plant.faults.silent:
            return ExcCodes.GATEWAY_NO_RESPONSE
        if written is not None:
            return self._take(address, [int(register) for register in written])
        for model_id, values in self._models().items():
            place = self._place[model_id]
            if place.start < address + count and address < place.stop:
                registers[place.start - BASE : place.stop - BASE] = encode(model_id, values)
        return None

    def _take(self, address: int, written: list[int]) -> ExcCodes | None:
        control = self._place[704].start
        first, last = control + offset(704, "WSetEna"), control + offset(704, "WSetRvrtTms") + 1
        if address < first or address + len(written) - 1 > last:
            if (address, len(written)) != (self._place[802].start + offset(802, "CtrlHb"), 1):
                return ExcCodes.ILLEGAL_ADDRESS
            self._controller_beat = written[0]
            return None
        block = encode(704, self._models()[704])
        block[address - control : address - control + len(written)] = written
        model = decode(704, block)
        self._control = {name: int(model.points[name].value or 0) for name in self._control}
        if address == first and not self._control["WSetEna"]:
            self._plant.take_back(self._string)
        elif address == first:
            after_s = self._control["WSetRvrtTms"] or math.inf
            self._plant.ask(self._string, value(model, "WSet") / 1000.0, self._plant.clock() + after_s)
        return None

    def _models(self) -> dict[int, dict[str, Any]]:
        """Return the points of every model, in the order of their registers."""
        reading = self._plant.readings().get(self._string) or self._plant.truth()[self._string]
        held = self._plant.holds(self._string)
        fault = reading.fault
        soc = {"SoC": _steps(1e4 * reading.soc)}
        # Powers in steps of 10 W, or larger ones with which nominal power fits into 16 bits. Devices without
        # scale factor simulate the fault of a wrong unit.
        nominal_kw = float(self._plant.system.nominal_kw[self._string])
        factor = next(factor for factor in range(1, 11) if nominal_kw * 10.0 ** (3 - factor) < 2**15 - 1)
        per_kw = 10.0 ** (3 - factor)
        in_watts = {"W_SF": None if self._plant.faults.kilowatts else factor}
        lapses_in_s = held[1] - self._plant.clock() if held else 0.0
        return {
            1: {"Mn": "bess", "Md": "simulated string", "SN": str(self._string + 1), "DA": 1},
            701: {
                "ACType": 2,
                "St": 0 if fault else 1,
                "InvSt": 6 if fault else 3,
                "ConnSt": 1,
                "W": _steps(per_kw * reading.power_kw),
                **in_watts,
            },
            702: {
                "WMaxRtg": _steps(per_kw * nominal_kw, math.floor),
                "WChaRteMax": _steps(per_kw * reading.charge_limit_kw, math.floor),
                "WDisChaRteMax": _steps(per_kw * reading.discharge_limit_kw, math.floor),
                **in_watts,
            },
            704: {
                **self._control,
                "WSet_SF": None if self._plant.faults.kilowatts else 0,
                "WSetEna": 1 if held else 0,
                "WSetRvrtRem": math.ceil(lapses_in_s) if lapses_in_s < math.inf else 0,
            },
            713: {**soc, "Sta": 2 if fault else 0, "Pct_SF": -2},
            802: {
                **soc,
                "SoC_SF": -2,
                "LocRemCtl": 0,
                "Hb": reading.beat % 0xFFFF,
                "CtrlHb": self._controller_beat,
                "State": 99 if fault else 3,
            },
            803: {
                "NStr": 0,
                "ModTmpMin": _steps(10.0 * reading.coldest_c),
                "ModTmpMax": _steps(10.0 * reading.hottest_c),
                "ModTmp_SF": -1,
            },
        }


def _steps(number: float, to_int: Callable[[float], int] = round) -> int | None:
    return None if math.isnan(number) else to_int(number)
