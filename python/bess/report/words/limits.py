"""What limits a plant, and what would help: the largest parts of what was lost, with a remedy for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.plant.flows import Limit
from bess.report.data import step_h
from bess.report.runs import Run
from bess.simulation.analysis.catalogue import kpi

_WORTH_NAMING = 0.15
"""Share of the loss from which a cause is named."""
_MANY_STARTS_PER_DAY = 12.0
_PART_LOAD = 0.5
"""Mean load of running inverters below which fewer of them would lose less."""


@dataclass(frozen=True)
class _Cause:
    kwh: float
    text: str
    remedy: str


def limit_sentences(run: Run) -> list[str]:
    """Name the two largest parts of the loss, each with what would lower it; and frequent starts."""
    causes = sorted(_causes(run), key=lambda cause: -cause.kwh)
    total = sum(cause.kwh for cause in causes)
    said = [
        f"{cause.text}: {kpi('lost_kwh').quantity(cause.kwh)}, {100.0 * cause.kwh / total:.0f} % of the "
        f"losses. {cause.remedy}"
        for cause in causes[:2]
        if cause.kwh > _WORTH_NAMING * total
    ]
    starts = run.kpis["starts_per_day"] / run.dataset.sizes["string"]
    if starts > _MANY_STARTS_PER_DAY:
        said.append(f"{starts:.0f} starts of each inverter a day. Fewer starts: raise the price of a start.")
    return said


def _causes(run: Run) -> Iterator[_Cause]:
    data, kpis = run.dataset, run.kpis
    hours = step_h(data)
    discharge = data["demand_kw"].values > 0.0
    hot_kw, shed_kw = (data[name].values for name in ("derating_loss_kw", "availability_loss_kw"))
    above_h = np.count_nonzero(data["unmet_kw"].values > 0.0) * hours
    yield _Cause(
        kpis["unmet_kwh"],
        f"Demand above the power in service in {above_h:,.0f} h",
        "More inverter power would help.",
    )
    losses = (
        ("Derating of hot strings", hot_kw, "More cooling, or less power at a time,"),
        ("Empty strings", shed_kw * discharge[:, None], "More energy in store, or charging before,"),
        ("Full strings", shed_kw * ~discharge[:, None], "More room in store, or discharging before,"),
    )
    for text, lost_kw, remedy in losses:
        lost_h = np.count_nonzero(lost_kw.sum(axis=1) > 0.0) * hours
        split = _another_split(run, lost_kw.sum(axis=1), discharge)
        yield _Cause(
            float(lost_kw.sum()) * hours, f"{text} in {lost_h:,.0f} h", f"{remedy} would help.{split}"
        )
    delivered_kw, nominal_kw = np.abs(data["delivered_kw"].values), run.system.nominal_kw
    load = delivered_kw.sum() / max(float(((delivered_kw > 0.0) * nominal_kw).sum()), 1e-9)
    yield _Cause(
        kpis["inverter_loss_kwh"],
        f"Inverters, at {100.0 * load:.0f} % of nominal power while they run",
        "Fewer inverters at a time would help." if load < _PART_LOAD else "Better inverters would help.",
    )
    cells_kwh = kpis["battery_loss_kwh"] + kpis.get("hysteresis_loss_kwh", 0.0)
    yield _Cause(cells_kwh, "Resistance and hysteresis of the cells", "Lower currents would help.")
    yield _Cause(kpis["auxiliary_kwh"], "Cooling", "A higher temperature at which it starts would help.")


def _another_split(run: Run, lost_kw: Array, discharge: NDArray[np.bool_]) -> str:
    """For how much of a loss other strings had power and energy left in the same step; "" if little."""
    data, system = run.dataset, run.system
    if lost_kw.sum() <= 0.0 or run.study.get("event"):
        return ""
    soc = data["soc"].values
    low, high = np.array([(each.battery.soc_min, each.battery.soc_max) for each in system.strings]).T
    room = np.where(discharge[:, None], soc - low, high - soc)
    spare_kw = np.minimum(
        system.nominal_kw - np.abs(data["delivered_kw"].values),
        room * system.nominal_energy_kwh / step_h(data),
    )
    bound = data["limits"].values.astype(int) & sum(Limit) > 0
    free_kw = np.where(bound, 0.0, np.maximum(spare_kw, 0.0)).sum(axis=1)
    share = np.minimum(free_kw, lost_kw).sum() / lost_kw.sum()
    if share < _WORTH_NAMING:
        return ""
    return (
        f" For {100.0 * share:.0f} % of it other strings had power and energy left: another split may help."
    )
