"""The linear program of a plant that is one store: energy, temperature, derating, cycles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bess.ems.store_layout import layout_of
from bess.errors import BessError
from bess.numbers import Array

_PRIMAL: Final = 4
"""The primal simplex method of HiGHS: the plan that does nothing is feasible, as is the one before."""

_NO_SCALING: Final = 0
"""Numbers of a program are between a thousandth and a thousand: scaling takes longer than it saves."""


@dataclass(frozen=True)
class Pieces:
    """Pieces of the plant's power in one direction.

    Attributes
    ----------
    width_kw : ndarray, shape (n_pieces,)
        Power of each.
    inverter, heat : ndarray, shape (n_pieces,)
        Loss per power within it; heat at the reference state.
    """

    width_kw: Array
    inverter: Array
    heat: Array


@dataclass(frozen=True)
class Banks:
    """The store in parts, in the order in which they are used: the last one is the deepest.

    Attributes
    ----------
    size_kwh : ndarray, shape (n_banks,)
        Energy each holds.
    charge, discharge : ndarray, shape (n_banks,)
        Heat per energy that passes, beside that of the pieces of power; rises from bank to bank.
    wear_eur_kwh : ndarray, shape (n_banks,)
        Price of energy drawn, beside that of all of it; does not fall from bank to bank.
    """

    size_kwh: Array
    charge: Array
    discharge: Array
    wear_eur_kwh: Array


@dataclass(frozen=True)
class Numbers:
    """What changes from one solve to the next; arrays of shape ``(n_blocks,)`` unless said otherwise.

    Attributes
    ----------
    charge_eur, discharge_eur : ndarray
        What a kWh charged costs, a kWh discharged earns.
    shortfall_eur : ndarray
        What a kWh asked for and not delivered costs.
    holding_eur : float
        What holding a kWh for an hour costs.
    end_eur : float
        Value of a kWh stored at the end.
    heat_charge, heat_discharge : ndarray
        Heat over that at the reference state.
    energy_kwh : ndarray, shape (n_banks,)
        In each bank at the start.
    temperature_c : float
        At the start.
    ambient_c : ndarray
        Ambient temperature.
    derated_kw : ndarray
        Power to which derating applies.
    allowed_kwh : ndarray, shape (n_days,)
        Stored energy that may be discharged on each day.
    throughput_kwh : float
        Mean of charged and discharged AC energy that the plan may reach.
    """

    charge_eur: Array
    discharge_eur: Array
    shortfall_eur: Array
    holding_eur: float
    end_eur: float
    heat_charge: Array
    heat_discharge: Array
    energy_kwh: Array
    temperature_c: float
    ambient_c: Array
    derated_kw: Array
    allowed_kwh: Array
    throughput_kwh: float


class StoreProgram:
    r"""Maximise income over the blocks of a plan; powers in pieces, the store in banks.

    With charging :math:`c` and discharging :math:`d` (AC, pieces :math:`i`), what enters (:math:`g`) and
    leaves (:math:`y`) each bank :math:`j` with energy :math:`e`, temperature :math:`\tau`, curtailed power
    :math:`q`, and blocks of :math:`n` control steps :math:`\Delta t` at constant power,
    :math:`T = n \Delta t`, :math:`r = 1 - k_2 \Delta t`, :math:`T' = (1 - r^n) / k_2`:

    .. math::
       \sum_j g_{jt} (1 + x^c_j) &= \eta \sum_i c_{it} (1 - w_i - \rho_t h_i), \quad
       \sum_j y_{jt} (1 - x^d_j) = \sum_i d_{it} (1 + w_i + \rho_t h_i) \\
       e_{jt} &= e_{j,t-1} + T_t\,(g_{jt} - y_{jt}), \quad 0 \le e_{jt} \le E_j \\
       \tau_t &= \tau_{t-1} + k_1 T'_t\,\bigl(\rho_t \sum_i h_i (c_{it} + d_{it})
       + \sum_j (x^c_j g_{jt} + x^d_j y_{jt})\bigr) - k_2 T'_t\,(\tau_{t-1} - \tau^{air}_t) \\
       q_t &\ge \hat p_t (1 - K(\bar\tau_t)), \quad \sum_i (c_{it} + d_{it}) + q_t \le P, \quad
       \sum_{t \in \text{day}, j} y_{jt} T_t \le C E \\
       \sum_i c_{it} &\le a^c_k + b^c_k \bar e_t, \quad \sum_i d_{it} \le a^d_k + b^d_k \bar e_t

    with the loss per power of each piece in the inverters :math:`w_i` and as heat :math:`h_i` (at a reference
    state; :math:`\rho_t` scales it), lines :math:`k` of the power that the voltage limits allow at the mean
    :math:`\bar e_t` of the energies at both ends of a block, the heat per energy of each bank beside it
    :math:`x_j`, the hysteresis :math:`\eta`, cycles a day :math:`C`, tangents of the derating factor
    :math:`K`, and the mean :math:`\bar\tau_t` of the temperatures at the ends of the block's steps. Losses
    that rise from piece to piece and from bank to bank are used in that order by themselves.
    """

    def __init__(
        self,
        dt_h: float,
        steps: npt.NDArray[np.int64],
        charge: Pieces,
        discharge: Pieces,
        banks: Banks,
        *,
        power_kw: float,
        stored_per_charged: float,
        warming_k_per_kwh: float,
        cooling_per_h: float,
        tangents: Array,
        tapers: tuple[Array, Array],
        day: npt.NDArray[np.int64],
    ):
        self._hours, self._charge, self._discharge, self._banks = steps * dt_h, charge, discharge, banks
        self._power_kw, self._hysteresis, self._tangents = power_kw, stored_per_charged, tangents
        self._tapers = tapers
        self._heat_of(dt_h, steps, warming_k_per_kwh, cooling_per_h)
        self._at = layout_of(
            (
                charge.width_kw.size, discharge.width_kw.size, banks.size_kwh.size, len(tangents),
                len(tapers[0]), len(tapers[1]),
            ),
            day,
        )  # fmt: skip
        self._bounds()
        self._solver = _solver()
        self._basis: Any = None

    def solve(self, numbers: Numbers) -> tuple[Array, Array]:
        """Return charging and discharging [kW], each of shape ``(n_blocks,)``.

        Starts from the basis of the last solve; the first one from that of the plan that does nothing.

        Raises
        ------
        BessError
            The program has no solution.
        """
        import highspy

        self._fill(numbers)
        at, solver = self._at, self._solver
        values = at.ordered(self._values(numbers))
        solver.passModel(
            at.n_columns, at.n_rows, values.size,
            int(highspy.MatrixFormat.kColwise), int(highspy.ObjSense.kMinimize), 0.0,
            self._cost, self._lower, self._upper, self._row_lower, self._row_upper,
            at.starts, at.indices, values, np.zeros(at.n_columns, dtype=np.int32),
        )  # fmt: skip
        solver.setBasis(self._basis or _basis(*at.of_rest()))
        solver.run()
        status = solver.getModelStatus()
        if status != highspy.HighsModelStatus.kOptimal:
            # A basis may leave the simplex method stuck; without one it starts elsewhere.
            solver.clearSolver()
            solver.run()
            status = solver.getModelStatus()
        if status != highspy.HighsModelStatus.kOptimal:
            raise BessError(f"the dispatch program has no solution; HiGHS says: {status.name}")
        self._basis = solver.getBasis()
        x = np.asarray(solver.getSolution().col_value)
        return x[at.c].sum(axis=1), x[at.d].sum(axis=1)

    def _heat_of(
        self, dt_h: float, steps: npt.NDArray[np.int64], warming_k_per_kwh: float, cooling_per_h: float
    ) -> None:
        """How much of a temperature a block keeps, and the weight of its end in the mean of its steps."""
        keep = np.minimum(1.0 - cooling_per_h * dt_h, 1.0 - 1e-9)  # without cooling: as good as none
        self._keep: Array = keep**steps
        self._warming: Array = warming_k_per_kwh * dt_h * (1.0 - self._keep) / (1.0 - keep)
        of_start = keep * self._warming / (warming_k_per_kwh * dt_h * steps)
        self._at_end: Array = (1.0 - of_start) / (1.0 - self._keep)

    def _bounds(self) -> None:
        """Bounds of columns and rows, as far as they stay."""
        at, n = self._at, self._at.n_columns
        self._lower, self._upper, self._cost = np.zeros(n), np.full(n, np.inf), np.zeros(n)
        self._upper[at.c], self._upper[at.d] = self._charge.width_kw, self._discharge.width_kw
        self._upper[at.e] = self._banks.size_kwh
        self._lower[at.tau] = -np.inf
        self._row_lower, self._row_upper = np.zeros(at.n_rows), np.zeros(at.n_rows)
        self._row_lower[at.limit], self._row_upper[at.limit] = -np.inf, self._power_kw
        self._row_upper[at.curtail] = np.inf
        self._row_lower[at.cycle] = self._row_lower[at.throughput] = -np.inf
        for rows, lines in zip((at.taper_c, at.taper_d), self._tapers, strict=True):
            self._row_lower[rows], self._row_upper[rows] = -np.inf, lines[:, 1]

    def _values(self, numbers: Numbers) -> list[Any]:
        """Values of the cells, in the order of the layout."""
        banks, charge, discharge = self._banks, self._charge, self._discharge
        hours, warming, at_end = (part[:, None] for part in (self._hours, self._warming, self._at_end))
        heat_c = numbers.heat_charge[:, None] * charge.heat
        heat_d = numbers.heat_discharge[:, None] * discharge.heat
        derated = -numbers.derated_kw[:, None] * self._tangents[:, 0]
        return [
            1.0 + banks.charge, 1.0 - banks.discharge,
            1.0, -1.0, -hours, hours,
            1.0, -self._keep[1:, None], -warming * banks.charge, -warming * banks.discharge,
            1.0, 1.0, 1.0, 1.0,
            hours,
            0.5 * hours, 0.5 * hours,
            -self._hysteresis * (1.0 - charge.inverter - heat_c), -(1.0 + discharge.inverter + heat_d),
            -warming * heat_c, -warming * heat_d,
            derated * at_end, (derated * (1.0 - at_end))[1:],
            *(part for lines in self._tapers for part in (1.0, -0.5 * lines[:, :1], -0.5 * lines[:, :1])),
        ]  # fmt: skip

    def _fill(self, numbers: Numbers) -> None:
        """Costs, and the bounds of rows that change."""
        at, hours, cost = self._at, self._hours[:, None], self._cost
        cost[at.c] = hours * numbers.charge_eur[:, None]
        cost[at.d] = -hours * numbers.discharge_eur[:, None]
        cost[at.y] = hours * self._banks.wear_eur_kwh
        cost[at.q] = hours * numbers.shortfall_eur[:, None]
        cost[at.e] = hours * numbers.holding_eur
        cost[at.e[-1]] -= numbers.end_eur
        heat = (1.0 - self._keep) * numbers.ambient_c
        heat[0] += self._keep[0] * numbers.temperature_c
        for bound in (self._row_lower, self._row_upper):
            bound[at.balance[0]] = numbers.energy_kwh
            bound[at.heat[:, 0]] = heat
        slope, offset = self._tangents.T
        curtailed = np.repeat(offset[None], hours.size, axis=0)
        curtailed[0] += slope * (1.0 - self._at_end[0]) * numbers.temperature_c
        self._row_lower[at.curtail] = numbers.derated_kw[:, None] * curtailed
        for rows, lines in zip((at.taper_c, at.taper_d), self._tapers, strict=True):
            self._row_upper[rows[0]] = lines[:, 1] + 0.5 * lines[:, 0] * numbers.energy_kwh.sum()
        self._row_upper[at.cycle] = numbers.allowed_kwh
        self._row_upper[at.throughput] = numbers.throughput_kwh


def _solver() -> Any:
    import highspy

    solver = highspy.Highs()  # type: ignore[no-untyped-call]
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("threads", 1)
    solver.setOptionValue("presolve", "off")
    solver.setOptionValue("simplex_strategy", _PRIMAL)
    solver.setOptionValue("simplex_scale_strategy", _NO_SCALING)
    return solver


def _basis(columns: npt.NDArray[np.bool_], rows: npt.NDArray[np.bool_]) -> Any:
    import highspy

    status = (highspy.HighsBasisStatus.kLower, highspy.HighsBasisStatus.kBasic)
    basis = highspy.HighsBasis()
    basis.col_status = [status[basic] for basic in columns.tolist()]
    basis.row_status = [status[basic] for basic in rows.tolist()]
    basis.valid, basis.alien = True, False
    return basis
