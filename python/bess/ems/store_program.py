"""The linear program of a plant that is one store: energy, temperature, derating, cycles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy import sparse

from bess.errors import BessError

Array = npt.NDArray[np.float64]


_DEVEX: Final = 1
"""Weights of the dual simplex method that are quicker here than the steepest edge."""


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
       \sum_{t \in \text{day}, j} y_{jt} T_t \le C E

    with the loss per power of each piece in the inverters :math:`w_i` and as heat :math:`h_i` (at a reference
    state; :math:`\rho_t` scales it), the heat per energy of each bank beside it :math:`x_j`, the hysteresis
    :math:`\eta`, cycles a day :math:`C`, tangents of the derating factor :math:`K`, and the mean
    :math:`\bar\tau_t` of the temperatures at the ends of the block's steps. Losses that rise from piece to
    piece and from bank to bank are used in that order by themselves.
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
        day: npt.NDArray[np.int64],
    ):
        self._hours, self._charge, self._discharge, self._banks = steps * dt_h, charge, discharge, banks
        self._power_kw, self._hysteresis, self._tangents = power_kw, stored_per_charged, tangents
        self._heat_of(dt_h, steps, warming_k_per_kwh, cooling_per_h)
        self._basis: Any = None
        self._columns(day.size)
        self._rows(day.size, day - day[0])

    def solve(self, numbers: Numbers) -> tuple[Array, Array]:
        """Return charging and discharging [kW], each of shape ``(n_blocks,)``.

        Starts from the basis of the last solve, if there was one.
        """
        import highspy

        self._fill(numbers)
        solver = highspy.Highs()  # type: ignore[no-untyped-call]
        solver.setOptionValue("output_flag", False)
        solver.setOptionValue("threads", 1)
        solver.setOptionValue("presolve", "off")
        solver.setOptionValue("simplex_dual_edge_weight_strategy", _DEVEX)
        values = self._values[self._order]
        solver.passModel(
            self._cost.size, self._row_lower.size, values.size,
            int(highspy.MatrixFormat.kColwise), int(highspy.ObjSense.kMinimize), 0.0,
            self._cost, self._lower, self._upper, self._row_lower, self._row_upper,
            self._starts, self._indices, values, np.zeros(self._cost.size, dtype=np.int32),
        )  # fmt: skip
        if self._basis is not None:
            solver.setBasis(self._basis)
        solver.run()
        status = solver.getModelStatus()
        if status != highspy.HighsModelStatus.kOptimal:
            raise BessError(f"the dispatch program has no solution; HiGHS says: {status.name}")
        self._basis = solver.getBasis()
        x = np.asarray(solver.getSolution().col_value)
        return x[self._c].sum(axis=1), x[self._d].sum(axis=1)

    def _heat_of(
        self, dt_h: float, steps: npt.NDArray[np.int64], warming_k_per_kwh: float, cooling_per_h: float
    ) -> None:
        """How much of a temperature a block keeps, and the weight of its end in the mean of its steps."""
        keep = np.minimum(1.0 - cooling_per_h * dt_h, 1.0 - 1e-9)  # without cooling: as good as none
        self._keep: Array = keep**steps
        self._warming: Array = warming_k_per_kwh * dt_h * (1.0 - self._keep) / (1.0 - keep)
        of_start = keep * self._warming / (warming_k_per_kwh * dt_h * steps)
        self._at_end: Array = (1.0 - of_start) / (1.0 - self._keep)

    def _columns(self, steps: int) -> None:
        """Columns of each block: pieces both ways, three of each bank, temperature, curtailed power."""
        n_c, n_d, n_b = (
            part.size for part in (self._charge.width_kw, self._discharge.width_kw, self._banks.size_kwh)
        )
        sizes = np.cumsum([0, n_c, n_d, n_b, n_b, n_b, 1, 1])
        first = sizes[-1] * np.arange(steps)
        self._c, self._d, self._g, self._y, self._e, tau, q = (
            first[:, None] + np.arange(low, high) for low, high in pairwise(sizes)
        )
        self._tau, self._q = tau[:, 0], q[:, 0]
        count = sizes[-1] * steps
        self._lower, self._upper, self._cost = np.zeros(count), np.full(count, np.inf), np.zeros(count)
        self._upper[self._c], self._upper[self._d] = self._charge.width_kw, self._discharge.width_kw
        self._upper[self._e] = self._banks.size_kwh
        self._lower[self._tau] = -np.inf

    def _rows(self, steps: int, day: npt.NDArray[np.int64]) -> None:
        """The matrix in the order HiGHS takes, with the places of the cells that change."""
        banks, hours = self._banks, self._hours[:, None]
        n_b, n_q = banks.size_kwh.size, len(self._tangents)
        row = (4 + n_b + n_q) * np.arange(steps)
        into, out, self._heat, limit = row[:, None], row[:, None] + 1, row + 2, row[:, None] + 3
        self._balance = row[:, None] + 4 + np.arange(n_b)
        self._curtail = row[:, None] + 4 + n_b + np.arange(n_q)
        heat = self._heat[:, None]
        self._cycle = (4 + n_b + n_q) * steps + np.arange(day[-1] + 1)
        self._throughput = int(self._cycle[-1]) + 1
        extra = self._warming[:, None]
        constant: list[tuple[Any, Any, Any]] = [
            (into, self._g, 1.0 + banks.charge),
            (out, self._y, 1.0 - banks.discharge),
            (self._balance, self._e, 1.0),
            (self._balance[1:], self._e[:-1], -1.0),
            (self._balance, self._g, -hours),
            (self._balance, self._y, hours),
            (self._heat, self._tau, 1.0),
            (self._heat[1:], self._tau[:-1], -self._keep[1:]),
            (heat, self._g, -extra * banks.charge),
            (heat, self._y, -extra * banks.discharge),
            (limit, self._c, 1.0),
            (limit, self._d, 1.0),
            (limit, self._q[:, None], 1.0),
            (self._curtail, self._q[:, None], 1.0),
            (self._cycle[day][:, None], self._y, hours),
            (self._throughput, self._c, 0.5 * hours),
            (self._throughput, self._d, 0.5 * hours),
        ]
        # In the order of _fill.
        changing = [
            (into, self._c), (out, self._d), (heat, self._c), (heat, self._d),
            (self._curtail, self._tau[:, None]), (self._curtail[1:], self._tau[:-1, None]),
        ]  # fmt: skip
        cells = [np.broadcast_arrays(*cell) for cell in constant + [(*cell, 0.0) for cell in changing]]
        rows, columns, values = (np.concatenate([cell[i].ravel() for cell in cells]) for i in range(3))
        count = self._throughput + 1
        # The numbers of the cells as data: what the conversion sorts is where each belongs.
        numbered = sparse.csc_array(
            (np.arange(1.0, rows.size + 1.0), (rows, columns)), shape=(count, self._cost.size)
        )
        self._order = numbered.data.astype(np.int64) - 1
        self._starts, self._indices = (part.astype(np.int32) for part in (numbered.indptr, numbered.indices))
        self._values = np.asarray(values, dtype=np.float64)
        self._changing = sum(cell[0].size for cell in cells[: len(constant)])
        self._row_lower, self._row_upper = np.zeros(count), np.zeros(count)
        self._row_lower[limit], self._row_upper[limit] = -np.inf, self._power_kw
        self._row_upper[self._curtail] = np.inf
        self._row_lower[self._cycle] = self._row_lower[self._throughput] = -np.inf

    def _fill(self, numbers: Numbers) -> None:
        hours, charge, discharge = self._hours, self._charge, self._discharge
        slope, offset = self._tangents.T
        derated = numbers.derated_kw[:, None]
        at_end = self._at_end[:, None]
        heat_c = numbers.heat_charge[:, None] * charge.heat
        heat_d = numbers.heat_discharge[:, None] * discharge.heat
        changing = (
            -self._hysteresis * (1.0 - charge.inverter - heat_c),
            -(1.0 + discharge.inverter + heat_d),
            -self._warming[:, None] * heat_c,
            -self._warming[:, None] * heat_d,
            -derated * slope * at_end,
            (-derated * slope * (1.0 - at_end))[1:],
        )
        self._values[self._changing :] = np.concatenate([part.ravel() for part in changing])
        self._cost[self._c] = (hours * numbers.charge_eur)[:, None]
        self._cost[self._d] = -(hours * numbers.discharge_eur)[:, None]
        self._cost[self._y] = hours[:, None] * self._banks.wear_eur_kwh
        self._cost[self._q] = hours * numbers.shortfall_eur
        self._cost[self._e] = (hours * numbers.holding_eur)[:, None]
        self._cost[self._e[-1]] -= numbers.end_eur
        for bound in (self._row_lower, self._row_upper):
            bound[self._balance[0]] = numbers.energy_kwh
            bound[self._heat] = (1.0 - self._keep) * numbers.ambient_c
            bound[self._heat[0]] += self._keep[0] * numbers.temperature_c
        self._row_lower[self._curtail] = derated * offset
        self._row_lower[self._curtail[0]] += (derated * slope * (1.0 - at_end))[0] * numbers.temperature_c
        self._row_upper[self._cycle] = numbers.allowed_kwh
        self._row_upper[self._throughput] = numbers.throughput_kwh
