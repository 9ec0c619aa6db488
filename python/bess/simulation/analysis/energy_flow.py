"""Energy flow of a run between grid and stored energy, with the losses of each direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bess.arrays import Array

if TYPE_CHECKING:
    import xarray as xr

LOSSES: Final = ("inverter", "battery", "hysteresis")


@dataclass(frozen=True)
class DirectionFlow:
    """Energy of one direction [kWh], summed over all steps and strings with power in this direction."""

    asked_kwh: float
    """Demand in this direction."""
    unmet_kwh: float
    derating_kwh: float
    availability_kwh: float
    """Unmet demand (above the power in service), derating loss and availability loss."""
    grid_kwh: float
    """Energy delivered at the AC side: the demand minus these three."""
    inverter_kwh: float
    battery_kwh: float
    hysteresis_kwh: float
    """Losses; the inverter loss without the standby losses drawn from the grid."""
    store_kwh: float
    """Change of the stored chemical energy, as a magnitude."""


@dataclass(frozen=True)
class EnergyFlow:
    r"""Energy of a run in both directions.

    Grid import is ``charge.grid_kwh + standby_kwh + auxiliary_kwh``, grid export ``discharge.grid_kwh``. In
    each direction, grid and stored energy differ by the losses and by the work of the open-circuit voltage,
    :math:`P_{shift}` in docs/equations.md.
    """

    charge: DirectionFlow
    discharge: DirectionFlow
    standby_kwh: float
    auxiliary_kwh: float

    @property
    def taken_kwh(self) -> float:
        """Grid import."""
        return self.charge.grid_kwh + self.standby_kwh + self.auxiliary_kwh


def energy_flow(dataset: xr.Dataset) -> EnergyFlow:
    """Return the energy flow of a record (``bess.open_result``)."""
    dt_h = float(dataset.attrs["step_h"])

    def power(name: str) -> Array:
        return np.asarray(dataset[name].values, dtype=np.float64)

    demand, delivered, request = power("demand_kw"), power("delivered_kw"), power("request_kw")
    drawn, standby = power("chemical_kw"), power("standby_kw")
    losses = {name: power(f"{name}_loss_kw") for name in LOSSES}
    losses["inverter"] = losses["inverter"] - standby
    discharges = np.where(delivered != 0.0, delivered > 0.0, drawn > 0.0)

    def direction(sign: float, flows: Array) -> DirectionFlow:
        asked, wanted = sign * demand > 0.0, sign * request > 0.0
        return DirectionFlow(
            asked_kwh=float(np.abs(demand[asked]).sum()) * dt_h,
            unmet_kwh=float(power("unmet_kw")[asked].sum()) * dt_h,
            derating_kwh=float(power("derating_loss_kw")[wanted].sum()) * dt_h,
            availability_kwh=float(power("availability_loss_kw")[wanted].sum()) * dt_h,
            grid_kwh=sign * float(delivered[flows].sum()) * dt_h,
            store_kwh=sign * float(drawn[flows].sum()) * dt_h,
            **{f"{name}_kwh": float(values[flows].sum()) * dt_h for name, values in losses.items()},
        )

    auxiliary = float(power("auxiliary_kw").sum()) * dt_h if "auxiliary_kw" in dataset else 0.0
    return EnergyFlow(
        direction(-1.0, ~discharges), direction(1.0, discharges), float(standby.sum()) * dt_h, auxiliary
    )
