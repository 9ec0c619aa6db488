"""What only SunSpec devices do, and devices that should not be driven."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from plant_partners import Connecting, Watched
from pymodbus.client import ModbusTcpClient

import bess
from bess.edge.plant_io import LinkError, calls, simulated_sunspec, sunspec_device
from bess.edge.plant_io.simulated import SimulatedPlant
from bess.edge.plant_io.simulated_sunspec import SimulatedDevices
from bess.errors import InputError

ASKED = np.array([40.0, -30.0, 92.0])


@pytest.fixture(autouse=True)
def _no_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing here is about slow answers: a machine under load has all the time it wants to give them."""
    monkeypatch.setattr(calls, "DEADLINE_S", 600.0)
    monkeypatch.setattr(sunspec_device, "ANSWER_S", 600.0)


@pytest.fixture
def devices(watched: Watched) -> Iterator[SimulatedDevices]:
    with SimulatedDevices(watched.plant) as devices:
        yield devices


@pytest.fixture
def modbus(devices: SimulatedDevices) -> Iterator[ModbusTcpClient]:
    client = ModbusTcpClient("127.0.0.1", port=int(devices.address.rpartition(":")[2]), retries=0)
    client.connect()
    yield client
    client.close()


Models = dict[int, dict[str, Any]]


@pytest.fixture
def altering(watched: Watched, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., SimulatedDevices]]:
    """Starts devices whose models have been altered."""
    whole = simulated_sunspec._Device._models
    with ExitStack() as stack:

        def started(alter: Callable[[Models], Models]) -> SimulatedDevices:
            monkeypatch.setattr(simulated_sunspec._Device, "_models", lambda self: alter(whole(self)))
            return stack.enter_context(SimulatedDevices(watched.plant))

        yield started


def _without(lacking: set[int]) -> Callable[[Models], Models]:
    return lambda models: {key: values for key, values in models.items() if key not in lacking}


def _model(modbus: ModbusTcpClient, model_id: int, unit: int = 1) -> tuple[int, object]:
    address = 40_002
    while True:
        found, length = modbus.read_holding_registers(address, count=2, device_id=unit).registers
        if found == model_id:
            registers = modbus.read_holding_registers(
                address, count=min(length + 2, 120), device_id=unit
            ).registers
            return address, sunspec_device.decode(model_id, registers)
        assert found != sunspec_device.END
        address += length + 2


def test_a_model_survives_its_registers() -> None:
    registers = sunspec_device.encode(704, {"WSet": -123_456, "WSet_SF": 1, "WSetRvrtTms": 60})
    model = sunspec_device.decode(704, registers)
    assert sunspec_device.value(model, "WSet") == -1_234_560.0
    assert sunspec_device.value(model, "WSetRvrtTms") == 60.0
    assert np.isnan(sunspec_device.value(model, "WSetPct"))


@pytest.mark.parametrize("factor", [None, 11, -11])
def test_a_power_without_a_scale_is_no_power(factor: int | None) -> None:
    model = sunspec_device.decode(701, sunspec_device.encode(701, {"W": 50, "W_SF": factor}))
    with pytest.raises(LinkError, match="scale factor W_SF"):
        sunspec_device.value(model, "W")


def test_the_time_to_revert_is_set_with_every_set_point(
    connecting: Connecting, devices: SimulatedDevices, modbus: ModbusTcpClient, watched: Watched
) -> None:
    link = connecting(devices.address)
    link.write(ASKED)
    watched.clock.now_s += 20.0
    _, control = _model(modbus, 704, unit=2)
    points = control.points  # type: ignore[attr-defined]
    assert (points["WSetEna"].value, points["WSetRvrtTms"].value, points["WSetRvrtRem"].value) == (1, 60, 40)
    assert sunspec_device.value(control, "WSet") == -30_000.0
    watched.clock.now_s += 40.0
    assert _model(modbus, 704, unit=2)[1].points["WSetEna"].value == 0  # type: ignore[attr-defined]


def test_what_cannot_be_taken_back_reverts_by_itself_and_is_no_error(
    connecting: Connecting, devices: SimulatedDevices, watched: Watched
) -> None:
    link = connecting(devices.address)
    link.write(ASKED)
    watched.plant.faults.silent.add(0)
    for _ in range(7):
        watched.clock.now_s += 10.0
        link.write(np.array([np.nan, *ASKED[1:]]))
    assert watched.power_kw() == pytest.approx([0.0, *ASKED[1:]], abs=0.01)


def test_the_heartbeat_counts_with_every_write(
    connecting: Connecting, devices: SimulatedDevices, modbus: ModbusTcpClient
) -> None:
    link = connecting(devices.address)
    beats = []
    for _ in range(3):
        link.write(ASKED)
        beats.append(_model(modbus, 802, unit=3)[1].points["CtrlHb"].value)  # type: ignore[attr-defined]
    assert np.diff(beats).tolist() == [1, 1]
    assert link.refresh_s == 1.0


def test_a_device_whose_heartbeat_stops_between_two_readings_is_written_nothing(
    connecting: Connecting, devices: SimulatedDevices, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "CLOCK", watched.clock)
    link = connecting(devices.address)
    link.read()
    for _ in range(2):
        watched.clock.now_s += 1.0
        link.write(ASKED)
    watched.plant.faults.severed.add(1)
    for _ in range(9):
        watched.clock.now_s += 1.0
        link.write(ASKED)
    watched.clock.now_s += 1.0
    with pytest.raises(
        LinkError, match=r"set-points of unit 2 at .* its heartbeat has been constant at 2 for 10 s"
    ):
        link.write(ASKED)
    assert link.read().available.tolist() == [True, False, True]
    watched.plant.faults.severed.clear()
    assert link.read().available.all()
    link.write(ASKED)


def test_a_counter_that_never_moves_is_no_heartbeat(
    connecting: Connecting,
    altering: Callable[..., SimulatedDevices],
    watched: Watched,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(calls, "CLOCK", watched.clock)
    link = connecting(altering(lambda models: models | {802: models[802] | {"Hb": 0}}).address)
    for _ in range(5):
        watched.clock.now_s += 60.0
        link.write(ASKED)
        assert link.read().available.all()


def test_a_counter_that_starts_anew_as_often_as_it_is_read_still_beats(
    connecting: Connecting,
    altering: Callable[..., SimulatedDevices],
    watched: Watched,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(calls, "CLOCK", watched.clock)

    def soon_anew(models: Models) -> Models:
        return models | {802: models[802] | {"Hb": int(watched.clock.now_s) % 20}}

    link = connecting(altering(soon_anew).address)
    for _ in range(3):
        assert link.read().available.all()
        for _ in range(20):
            link.write(ASKED)
            watched.clock.now_s += 1.0


def test_a_device_takes_nothing_but_its_controls(modbus: ModbusTcpClient, watched: Watched) -> None:
    for model_id, point in ((701, "W"), (702, "WMax"), (704, "WMaxLimPct"), (713, "SoC")):
        address, model = _model(modbus, model_id)
        where = address + model.points[point].offset  # type: ignore[attr-defined]
        assert modbus.write_registers(where, [1], device_id=1).isError()
    assert watched.asked == []


@pytest.mark.parametrize(
    ("lacking", "message"),
    [
        ({704}, "has no model 704"),
        ({701}, "has no model 701"),
        ({713, 802}, "neither model 713 nor 802"),
    ],
)
def test_a_device_without_what_is_needed_is_refused(
    connecting: Connecting, altering: Callable[..., SimulatedDevices], lacking: set[int], message: str
) -> None:
    link = connecting(altering(_without(lacking)).address)
    with pytest.raises(LinkError, match=message):
        link.read()


@pytest.mark.parametrize("lacking", [{713}, {802}, {702, 803}])
def test_a_device_with_only_what_is_needed_is_driven(
    connecting: Connecting, altering: Callable[..., SimulatedDevices], lacking: set[int]
) -> None:
    link = connecting(altering(_without(lacking)).address)
    link.write(ASKED)
    said = link.read()
    assert said.available.all()
    assert said.power_kw == pytest.approx(ASKED, abs=0.01)
    assert np.isinf(said.charge_limit_kw).all() == (702 in lacking)
    assert np.isnan(said.temperature_c).all() == (803 in lacking)
    assert link.refresh_s == (20.0 if 802 in lacking else 1.0)


def test_the_one_temperature_that_a_device_knows_is_used(
    connecting: Connecting, altering: Callable[..., SimulatedDevices]
) -> None:
    hot = {"ModTmpMin": None, "ModTmpMax": 523}
    link = connecting(altering(lambda models: models | {803: models[803] | hot}).address)
    assert link.read().temperature_c == pytest.approx([52.3] * 3)


@pytest.mark.parametrize(
    ("lacking", "remark"),
    [
        ({701: {"W": None}}, "the device reports no power"),
        ({713: {"SoC": None}, 802: {"SoC": None}}, "the device reports no state of charge"),
        (
            {701: {"W": None}, 713: {"SoC": None}, 802: {"SoC": None}},
            "the device reports no state of charge and no power",
        ),
    ],
)
def test_a_reading_that_a_device_does_not_give_is_named(
    connecting: Connecting, altering: Callable[..., SimulatedDevices], lacking: Models, remark: str
) -> None:
    link = connecting(
        altering(lambda models: models | {m: models[m] | gone for m, gone in lacking.items()}).address
    )
    assert link.read().remarks == (remark,) * 3


def test_a_set_point_in_per_cent_is_read_back_in_kilowatts(
    connecting: Connecting, altering: Callable[..., SimulatedDevices]
) -> None:
    foreign = {"WSetEna": 1, "WSetMod": 0, "WSetPct": -505, "WSetPct_SF": -1}
    link = connecting(altering(lambda models: models | {704: models[704] | foreign}).address)
    assert link.read().setpoint_kw == pytest.approx([-0.505 * 92.0] * 3)


def test_a_device_that_is_silent_from_the_start_is_named_with_the_exception_of_its_gateway(
    connecting: Connecting, devices: SimulatedDevices, watched: Watched
) -> None:
    watched.plant.faults.silent.add(1)
    remark = connecting(devices.address).read().remarks[1]
    assert remark.endswith("refuses register 40000 (Modbus exception 11)")


def test_powers_of_megawatts_fit_into_the_registers_of_a_simulated_device(connecting: Connecting) -> None:
    with SimulatedDevices(SimulatedPlant(bess.load_system("m5bat"))) as devices:
        link = connecting(devices.address, 10)
        link.write(np.full(10, 600.0))
        said = link.read()
    nominal_kw = devices.plant.system.nominal_kw
    assert said.available.all()
    assert said.power_kw.max() == pytest.approx(600.0, abs=0.1)
    assert (said.discharge_limit_kw <= nominal_kw).all() and said.discharge_limit_kw.max() > 400.0


def test_a_device_that_cannot_revert_is_not_driven(
    connecting: Connecting, altering: Callable[..., SimulatedDevices], watched: Watched
) -> None:
    def without(models: Models) -> Models:
        control = {key: value for key, value in models[704].items() if key != "WSetRvrtTms"}
        return models | {704: control}

    link = connecting(altering(without).address)
    assert link.read().available.all()
    with pytest.raises(LinkError, match="would never expire, so it is not controlled"):
        link.write(ASKED)
    assert watched.asked == []


def test_a_modbus_server_without_sunspec_is_said_to_be_one(
    connecting: Connecting, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_sunspec, "MARK", (1, 2))
    with SimulatedDevices(watched.plant) as devices:
        link = connecting(devices.address)
        with pytest.raises(LinkError, match="holds no SunSpec models at 40000, 0, 50000"):
            link.read()


def test_strings_may_be_behind_addresses_of_their_own(connecting: Connecting, watched: Watched) -> None:
    with SimulatedDevices(watched.plant) as one, SimulatedDevices(watched.plant) as other:
        elsewhere = other.address.removeprefix("sunspec=")
        link = connecting(f"{one.address}?unit=1,2@{elsewhere},3@{elsewhere}")
        link.write(ASKED)
        assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)
        assert link.read().power_kw == pytest.approx(ASKED, abs=0.01)
        other.stop()
        assert link.read().available.tolist() == [True, False, False]
        with pytest.raises(
            LinkError, match=f"set-points of unit 2 at {elsewhere}, unit 3 at {elsewhere} not"
        ):
            link.write(-ASKED)
        assert watched.power_kw() == pytest.approx([-ASKED[0], *ASKED[1:]], abs=0.01)
        other.start()
        link.write(-ASKED)
        assert watched.power_kw() == pytest.approx(-ASKED, abs=0.01)


@pytest.mark.parametrize(
    "option",
    [
        "unit=1,2,248",
        "unit=1,2,x",
        "unit=1,2,-3",
        "unit=1,2,3@",
        "unit=1,2,3@host:0",
        "unit=1,2,3@host:x",
        "unit=1,2,3@host/path",
        "unit=1,2,3@a..b",
        "unit=1,2,2@127.0.0.1:9",
    ],
)
def test_a_unit_must_be_one_of_modbus(connecting: Connecting, option: str) -> None:
    with pytest.raises(InputError, match=r"each 0 to 247, or 1@HOST:PORT if it is elsewhere"):
        connecting(f"sunspec=127.0.0.1:9?{option}")
