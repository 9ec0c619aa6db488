"""An explicit controller: tables of its plant, and weights; ``policy.json`` on disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from bess import _core
from bess.arrays import Array
from bess.errors import InputError
from bess.files import parse_json, read_file
from bess.system import State, System
from bess.system.battery import Battery

Numbers = tuple[FiniteFloat, ...]
Count = Annotated[int, Field(ge=1)]

NEAR_H: Final = 6.0
"""Length of the near part of the forecast [h]."""
NO_LIMIT_V: Final = 1e9
"""Maximum voltage of a string without a limit [V], because JSON has no infinity."""


class Tables(BaseModel):
    """Constants of the control law (``decision.rs`` of the core), without the weights.

    Arrays over several axes are flat; the last axis varies fastest. ``side`` is 0 for charge, else 1.

    Attributes
    ----------
    strings : int
        Number of strings.
    soc_knots, temperature_knots, derating_knots, power_knots, heat_knots, low_knots : int
        Lengths of the axes.
    steps, near_steps : int
        Control steps of the forecast, and of its near part.
    step_h : float
        Control step [h].
    step_share, near_share : float
        ``1 / steps`` and ``1 / near_steps``.
    shortfall : float
        Weight of undelivered energy over losses [kWh/kWh].
    soc_axis, temperature_axis : tuple of float
        Knots of the two tables below, common to all strings; [degC].
    ocv_v, resistance_ohm : tuple of float
        Open-circuit voltage [V] and resistance [Ohm] over (side, string, SOC, temperature).
    derating_c, derating_factor : tuple of float
        Derating table of each string over temperature [degC].
    power_kw : tuple of float
        Knots of the inverter's loss tables [kW] of each string.
    loss_kw : tuple of float
        Inverter loss [kW] over (side, string, knot).
    idle_loss_kw, capacity_ah, energy_kwh, soc_min, soc_max : tuple of float
        Of each string: loss of the inverter when off [kW], capacity [Ah], energy of the SOC window [kWh], and
        limits of the window.
    voltage_min_v, voltage_max_v, derating_start_c : tuple of float
        Of each string: lowest voltage in discharge and highest in charge [V], temperature at which derating
        starts [degC].
    heat_k : tuple of float
        Knots of the price of heat: temperature above the start of derating [K].
    low_fill : tuple of float
        Fills (shares of the SOC window) below which stored energy is preserved.
    high_fill : float
        Fill above which headroom is preserved.
    share : tuple of float
        Requests at which the cost of a string is evaluated, as shares of the maximum.
    min_power_kw : float
        Minimum power of an inverter that is on [kW].
    flattest, shed_slope, crumbs, unbounded : float
        Minimum curvature of the cost of a string [1/kW], curvature of the cost of undelivered power [1/kW],
        rounding tolerance as a share of plant power, and a cost above all others [kW].
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    strings: Annotated[int, Field(ge=1, le=32)]
    soc_knots: Annotated[int, Field(ge=2)]
    temperature_knots: Annotated[int, Field(ge=2)]
    derating_knots: Annotated[int, Field(ge=2)]
    power_knots: Annotated[int, Field(ge=2)]
    heat_knots: Annotated[int, Field(ge=2)] = 5
    low_knots: Count = 3
    steps: Count
    near_steps: Count
    step_h: FiniteFloat
    step_share: FiniteFloat
    near_share: FiniteFloat
    shortfall: FiniteFloat
    soc_axis: Numbers
    temperature_axis: Numbers
    ocv_v: Numbers
    resistance_ohm: Numbers
    derating_c: Numbers
    derating_factor: Numbers
    power_kw: Numbers
    loss_kw: Numbers
    idle_loss_kw: Numbers
    capacity_ah: Numbers
    energy_kwh: Numbers
    soc_min: Numbers
    soc_max: Numbers
    voltage_min_v: Numbers
    voltage_max_v: Numbers
    derating_start_c: Numbers
    heat_k: Numbers = (-30.0, -15.0, -5.0, 0.0, 5.0)
    low_fill: Numbers = (0.05, 0.12, 0.3)
    high_fill: FiniteFloat = 0.9
    share: Numbers = (0.0, 0.5, 1.0)
    min_power_kw: FiniteFloat = 1e-3
    flattest: FiniteFloat = 1e-6
    shed_slope: FiniteFloat = 1e-3
    crumbs: FiniteFloat = 1e-9
    unbounded: FiniteFloat = 1e30

    @classmethod
    def of(cls, system: System, steps: int, step_h: float, shortfall: float) -> Self:
        """Return the tables of a plant, for a forecast of ``steps`` control steps of ``step_h``."""
        strings = system.strings
        batteries = [string.battery for string in strings]
        soc = np.array(sorted({value for battery in batteries for value in _soc_knots(battery)}))
        axes_c = ((*battery.ocv_v.temperature_c, *battery.resistance_axes[1]) for battery in batteries)
        temperature_c = np.array(sorted({value for axis_c in axes_c for value in axis_c}))
        if temperature_c.size == 1:
            temperature_c = np.append(temperature_c, temperature_c[0] + 1.0)
        derating_knots = max(len(string.derating.factor) for string in strings)
        power_knots = max(len(string.inverter.load) for string in strings)
        derating = [
            _lengthened((s.derating.temperature_c, s.derating.factor), derating_knots) for s in strings
        ]
        inverters = [
            _lengthened((each.load, each.loss_charge, each.loss_discharge), power_knots) * each.nominal_kw
            for each in (string.inverter for string in strings)
        ]
        near_steps = min(steps, max(1, round(NEAR_H / step_h)))
        window = np.array([battery.soc_max - battery.soc_min for battery in batteries])
        ocv_v, resistance_ohm = zip(*_circuit(system, soc, temperature_c), strict=True)
        tables: dict[str, Any] = {
            "ocv_v": ocv_v,
            "resistance_ohm": resistance_ohm,
            "derating_c": [rows[0] for rows in derating],
            "derating_factor": [rows[1] for rows in derating],
            "power_kw": [rows[0] for rows in inverters],
            "loss_kw": [rows[1 + side] for side in (0, 1) for rows in inverters],
            "idle_loss_kw": [string.inverter.off_loss * string.inverter.nominal_kw for string in strings],
            "capacity_ah": system.capacity_ah,
            "energy_kwh": system.nominal_energy_kwh * window,
            "soc_min": [battery.soc_min for battery in batteries],
            "soc_max": [battery.soc_max for battery in batteries],
            "voltage_min_v": [battery.voltage_min_v for battery in batteries],
            "voltage_max_v": [min(battery.voltage_max_v, NO_LIMIT_V) for battery in batteries],
            "derating_start_c": [string.derating.start_c for string in strings],
            "soc_axis": soc,
            "temperature_axis": temperature_c,
        }
        flat: dict[str, Any] = {
            name: tuple(np.asarray(values, dtype=float).ravel().tolist()) for name, values in tables.items()
        }
        return cls(
            strings=len(strings),
            soc_knots=soc.size,
            temperature_knots=temperature_c.size,
            derating_knots=derating_knots,
            power_knots=power_knots,
            steps=steps,
            near_steps=near_steps,
            step_h=step_h,
            step_share=1.0 / steps,
            near_share=1.0 / near_steps,
            shortfall=shortfall,
            min_power_kw=float(system.min_power_kw.max()),
            **flat,
        )


def _soc_knots(battery: Battery) -> set[float]:
    soc, _ = battery.resistance_axes
    if battery.resistance_table is None:  # resistance depends on SOC below the switch only
        soc = (*(value for value in soc if value < battery.low_soc_switch), battery.low_soc_switch)
    return {*battery.ocv_v.soc, *soc}


def _circuit(system: System, soc: Array, temperature_c: Array) -> Iterator[tuple[Array, Array]]:
    """Open-circuit voltage and resistance of new strings at all knots, for charge and for discharge."""
    new = np.ones(system.n_strings)
    model = system.control_at(State(0.5 * new, 25.0 * new))
    knots = np.meshgrid(soc, temperature_c, indexing="ij")
    soc_grid, temperature_grid = (np.outer(new, each) for each in knots)
    for discharge in (False, True):
        yield model.coefficients(soc_grid, temperature_grid, discharge)


def _lengthened(rows: Sequence[Sequence[float]], length: int) -> Array:
    """Return the same piecewise linear functions with more knots, by halving the last segment."""
    out = [list(row) for row in rows]
    while len(out[0]) < length:
        for row in out:
            row.insert(-1, 0.5 * (row[-2] + row[-1]))
    return np.array(out)


N_WEIGHTS: Final = _core.Explicit.N_WEIGHTS
"""Weights of a controller; the control law (``decision.rs`` of the core) defines their positions."""


class ExplicitController(BaseModel):
    """An explicit controller, as stored in ``policy.json``.

    Attributes
    ----------
    format : int
        Version of the file's layout.
    study, system : str
        Study and system of the training, for information.
    weights : tuple of float
        Fitted weights of the control law.
    tables : Tables
        Tables of the plant, and length of the demand forecast.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    study: str
    system: str
    weights: Annotated[tuple[FiniteFloat, ...], Field(min_length=N_WEIGHTS, max_length=N_WEIGHTS)]
    tables: Tables

    def model_post_init(self, context: Any) -> None:
        """Raise InputError if the tables do not fit each other."""
        try:
            _ = self.core
        except ValueError as error:
            raise InputError(f"tables of an explicit controller: {error}") from error

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read ``policy.json``.

        Raises
        ------
        InputError
            The file is missing, or not from ``bess distil``.
        """
        raw = read_file(path)
        try:
            return cls.model_validate(parse_json(raw))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"])) or "file"
            raise InputError(f"{path}: {place}: {first['msg']}; use a file of bess distil") from error
        except ValueError as error:
            raise InputError(f"{path}: is not a policy from bess distil ({error})") from error

    def to_json(self) -> str:
        """Text of ``policy.json``."""
        return self.model_dump_json(indent=1) + "\n"

    def run(
        self, plant: _core.Plant, ahead_kw: Array, limit_kw: Array, ambient_c: Array, step_s: float
    ) -> dict[str, Array]:
        """See :class:`bess.plant.plant.CoreController`."""
        weights, features = np.array([self.weights]), self.core.demand_features(ahead_kw)[:, None, :]
        demand_kw = np.ascontiguousarray(ahead_kw[:, :1])
        return self.core.run(plant, weights, demand_kw, features, limit_kw, ambient_c[:, None], step_s)

    @cached_property
    def core(self) -> _core.Explicit:
        """Control law in the core, with weights as arguments."""
        return _core.Explicit(self.tables.model_dump())

    def split(self, state: State, ahead_kw: Array, limit_kw: Array) -> Array:
        """Allocate the demand of the current step.

        Parameters
        ----------
        state : State
            Measured state of every string.
        ahead_kw : ndarray, shape (tables.steps,)
            Demand [kW] of this step, at most the sum of the limits, and of the next ones; positive =
            discharge.
        limit_kw : ndarray, shape (n_strings,)
            Maximum power of each inverter [kW]; 0 = out of service.

        Returns
        -------
        ndarray, shape (n_strings,)
            Set-points [kW], signed as the demand; they sum to the demand.
        """
        return self.core.split(np.array(self.weights), state, limit_kw, ahead_kw)
