"""KPIs of a run, from the record of the plant only (docs/equations.md, KPIs)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bess.arrays import Array
from bess.control.policies.planned import PLANNED
from bess.simulation.analysis.lifetime import budget_kpis, contract_kpis, wear_kpis
from bess.simulation.analysis.services import is_reserve, is_site, service_kpis
from bess.simulation.analysis.settlement import dispatch_kpis, has_prices, settlement_kpis
from bess.simulation.record.dataset import check_record, with_initial
from bess.simulation.record.result import Result, record_of
from bess.units import KWH_PER_MWH, PERCENT

if TYPE_CHECKING:
    import xarray as xr


_NEEDED: Final = (
    *("demand_kw", "unmet_kw", "request_kw", "delivered_kw", "availability_loss_kw", "derating_loss_kw"),
    *("inverter_loss_kw", "battery_loss_kw", "soc", "temperature_c", "node_max_c", "inverter_starts"),
    *("ledger_residual_kwh", "solver_status", "solver_gap", "solver_search_gap", "solver_nodes", "fallback"),
)


def kpis(result: Result | xr.Dataset) -> dict[str, float]:
    """Return the KPIs of a result or dataset.

    Labels, units and meanings are in :data:`bess.simulation.analysis.catalogue.CATALOGUE`; KPIs without data
    in the record, such as those of services, budgets, contracts and ageing, are omitted. Availability and the
    four efficiencies are defined as in [1]_.

    With demand ``D`` (including unmet demand), requests ``u``, availability loss ``a``, derating loss ``d``,
    inverter loss ``w`` and battery heat ``h``, sums over strings and steps, 0/0 = 100 %:

    - ``availability_pct`` ``1 - sum a / sum |D|``; unmet demand is not an availability loss, but
      ``unmet_kwh``, and lowers ``fulfilment_pct``;
    - ``derating_efficiency_pct`` ``1 - sum d / sum |u|``, ``inverter_efficiency_pct`` with ``w``,
      ``battery_efficiency_pct`` with ``h``, ``system_efficiency_pct`` with ``w + h``, all of active power;
    - ``fulfilment_pct`` ``sum |delivered| / sum |D|``; ``undelivered_kwh`` ``sum (a + d)``, ``lost_kwh``
      ``sum (a + d + w + h)``, without ``hysteresis_loss_kwh``;
    - ``round_trip_efficiency_pct`` grid export over grid import at the plant's meter: delivered power minus
      standby and auxiliaries, summed over the strings. If initial and final chemical energy differ, the ratio
      is corrected to ``(given / drawn) (stored / taken)``. Omitted without import or export;
    - peak temperatures and spreads include the initial state, except ``peak_node_temperature_c``; that of a
      part of a run, such as ``dataset.sel(time="2024-03")``, is the state at the end of its first step;
    - ``ledger_residual_ratio``, the sum of absolute residuals over the delivered energy;
    - median, 95th percentile and maximum of gaps and nodes over the steps with a certified split. A
      :class:`bess.Result` adds the wall-clock ``solve_time_s_*``.

    Raises
    ------
    InputError
        The argument is neither a result nor its dataset, or lacks variables, strings or steps.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    """
    dataset = record_of(result, "kpis")
    check_record(dataset, _NEEDED, "kpis")
    values = {name: float(value) for name, value in _figures(dataset)}
    values |= {name: float(value) for name, value in contract_kpis(dataset, values)}
    times = _spread("solve_time_s", getattr(result, "solve_time_s", np.zeros(0)))
    return values | {name: float(value) for name, value in times}


def _figures(dataset: xr.Dataset) -> Iterator[tuple[str, Any]]:
    dt_h = float(dataset.attrs["step_h"])

    def energy_kwh(name: str) -> float:
        return float(np.abs(dataset[name].values).sum()) * dt_h

    demand, request = energy_kwh("demand_kw"), energy_kwh("request_kw")
    delivered, unmet = energy_kwh("delivered_kw"), energy_kwh("unmet_kw")
    shed, derated = energy_kwh("availability_loss_kw"), energy_kwh("derating_loss_kw")
    inverter, battery = energy_kwh("inverter_loss_kw"), energy_kwh("battery_loss_kw")
    of_cells = "chemical_kw" in dataset  # which a dataset of the user may lack
    yield "availability_pct", _left_pct(shed, demand)
    yield "derating_efficiency_pct", _left_pct(derated, request)
    yield "inverter_efficiency_pct", _left_pct(inverter, request)
    yield "battery_efficiency_pct", _left_pct(battery, request)
    yield "system_efficiency_pct", _left_pct(inverter + battery, request)
    yield "fulfilment_pct", _left_pct(demand - delivered, demand)
    auxiliary = energy_kwh("auxiliary_kw") if "auxiliary_kw" in dataset else 0.0
    yield "auxiliary_kwh", auxiliary
    if "auxiliary_kw" in dataset:
        yield "system_efficiency_with_auxiliaries_pct", _left_pct(inverter + battery + auxiliary, request)
    if of_cells:
        yield from _round_trip(dataset)
    yield from _temperatures(dataset)
    yield from _operation(dataset)
    yield "demand_kwh", demand
    yield "unmet_kwh", unmet
    flow_kw = dataset["delivered_kw"].values
    yield "charged_kwh", float(np.maximum(-flow_kw, 0.0).sum()) * dt_h
    yield "discharged_kwh", float(np.maximum(flow_kw, 0.0).sum()) * dt_h
    yield "request_kwh", request
    yield "delivered_kwh", delivered
    yield "availability_loss_kwh", shed
    yield "derating_loss_kwh", derated
    yield "inverter_loss_kwh", inverter
    yield "battery_loss_kwh", battery
    if of_cells:
        yield "hysteresis_loss_kwh", energy_kwh("hysteresis_loss_kw")
    yield "undelivered_kwh", shed + derated
    yield "lost_kwh", shed + derated + inverter + battery
    if "reactive_kvar" in dataset:
        yield "reactive_demand_kvarh", float(np.abs(dataset["reactive_demand_kvar"].values).sum()) * dt_h
        yield "reactive_kvarh", float(np.abs(dataset["reactive_kvar"].values).sum()) * dt_h
    residual = float(np.abs(dataset["ledger_residual_kwh"].values).sum())
    yield "ledger_residual_ratio", residual / delivered if delivered > 0.0 else residual
    if has_prices(dataset):
        if not (is_reserve(dataset) or is_site(dataset)):
            sold_kw = dataset["delivered_kw"].values.sum(axis=1)
            yield "revenue_eur", (sold_kw * dataset["price_eur_mwh"].values).sum() * dt_h / KWH_PER_MWH
        yield from settlement_kpis(dataset)
    if "expected_kw" in dataset:
        yield from dispatch_kpis(dataset)
    yield from service_kpis(dataset)
    yield from wear_kpis(dataset)
    yield from budget_kpis(dataset)
    yield from _solver(dataset)


def _round_trip(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Round-trip efficiency with the losses of each direction, so that stored energy is not a loss."""
    meter_kw = (dataset["delivered_kw"].values - dataset["standby_kw"].values).sum(axis=1)
    if "auxiliary_kw" in dataset:
        meter_kw = meter_kw - dataset["auxiliary_kw"].values
    chemical_kw = dataset["chemical_kw"].values.sum(axis=1)
    gives = meter_kw > 0.0
    given, taken = meter_kw[gives].sum(), -meter_kw[~gives].sum()
    drawn, stored = chemical_kw[gives].sum(), -chemical_kw[~gives].sum()
    if drawn > 0.0 and stored > 0.0:
        yield "round_trip_efficiency_pct", PERCENT * (given / drawn) * (stored / taken)


def _temperatures(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    states = with_initial(dataset, "temperature_c")
    yield "peak_mean_temperature_c", states.mean(axis=1).max()
    yield "peak_string_temperature_c", states.max()
    yield "peak_node_temperature_c", dataset["node_max_c"].values.max()
    for moment, spread_k in _between_strings(states):
        yield f"temperature_spread_{moment}_k", spread_k


def _operation(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    soc = with_initial(dataset, "soc")
    for moment, spread in _between_strings(soc):
        yield f"soc_spread_{moment}", spread
    yield "full_cycles", np.abs(np.diff(soc, axis=0)).sum(axis=0).mean() / 2.0
    starts = dataset["inverter_starts"].values.sum(axis=0)
    yield "inverter_starts_mean", starts.mean()
    yield "inverter_starts_max", starts.max()
    yield "starts_per_day", 24.0 * starts.sum() / (dataset.sizes["time"] * float(dataset.attrs["step_h"]))


def _between_strings(states: Array) -> Iterator[tuple[str, float]]:
    """Largest minus smallest over the strings of ``(n_times, n_strings)``."""
    spread = np.ptp(states, axis=1)
    yield from (("start", spread[0]), ("end", spread[-1]), ("mean", spread.mean()), ("max", spread.max()))


def _solver(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    solved = dataset["solver_status"].values != 0
    yield "fallback_steps", dataset["fallback"].values.sum()
    yield "solver_steps", solved.sum()
    planned = dataset["solver_status"].values == PLANNED
    for key, name in (("plan_gap_pct", "solver_gap"), ("plan_search_gap_pct", "solver_search_gap")):
        of_plans = dataset[name].values[planned].astype(np.float64)
        if np.isfinite(of_plans).any():
            yield key, PERCENT * np.nanmedian(of_plans)
    certified = solved & ~planned
    for name in ("solver_gap", "solver_search_gap", "solver_nodes"):
        values = dataset[name].values[certified].astype(np.float64)
        yield from _spread(name, values[np.isfinite(values)])


def _spread(name: str, values: Array) -> Iterator[tuple[str, float]]:
    """Empty for runs of rules or plans, which have no such values."""
    if values.size:
        yield f"{name}_median", np.median(values)
        yield f"{name}_p95", np.quantile(values, 0.95)
        yield f"{name}_max", values.max()


def _left_pct(loss: float, total: float) -> float:
    return PERCENT if total == 0.0 else PERCENT * (1.0 - loss / total)
