"""Energy flow of a run between grid and stored energy, with the losses of each direction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bess.arrays import Array, Flags

if TYPE_CHECKING:
    import xarray as xr


def energy_flow(dataset: xr.Dataset) -> dict[str, dict[str, float]]:
    r"""Return the energy of a record (``bess.open_result``) by direction [kWh].

    The sums of ``charge`` and ``discharge`` are over all steps and strings with power in this direction:
    ``asked`` (demand), ``unmet`` (demand above the power in service), ``derating`` and ``availability``
    losses, ``grid`` (delivered at the AC side: the demand minus these three), ``inverter``, ``battery`` and
    ``hysteresis`` losses, and ``store``, the change of the stored chemical energy, as a magnitude.

    The directions have no part in ``beside``: ``standby`` losses, which inverters that are off draw from the
    grid, and ``auxiliary``, the energy of cooling. Grid import is ``grid`` of charge and these two. In each
    direction, grid and stored energy differ by the losses and by the work of the open-circuit voltage,
    :math:`P_{shift}` in docs/equations.md.
    """
    dt_h = float(dataset.attrs["step_h"])
    demand, delivered, request, drawn, standby = (
        dataset[f"{name}_kw"].values for name in ("demand", "delivered", "request", "chemical", "standby")
    )
    discharges = np.where(delivered != 0.0, delivered > 0.0, drawn > 0.0)

    def energy(kw: Array, counts: Flags) -> float:
        return float(kw[counts].sum()) * dt_h

    def direction(sign: float, flows: Flags) -> dict[str, float]:
        asked, wanted = sign * demand > 0.0, sign * request > 0.0
        return {
            "asked": energy(np.abs(demand), asked),
            "unmet": energy(dataset["unmet_kw"].values, asked),
            "derating": energy(dataset["derating_loss_kw"].values, wanted),
            "availability": energy(dataset["availability_loss_kw"].values, wanted),
            "grid": energy(sign * delivered, flows),
            "inverter": energy(dataset["inverter_loss_kw"].values - standby, flows),
            "battery": energy(dataset["battery_loss_kw"].values, flows),
            "hysteresis": energy(dataset["hysteresis_loss_kw"].values, flows),
            "store": energy(sign * drawn, flows),
        }

    auxiliary = float(dataset["auxiliary_kw"].values.sum()) * dt_h if "auxiliary_kw" in dataset else 0.0
    beside = {"standby": float(standby.sum()) * dt_h, "auxiliary": auxiliary}
    return {"charge": direction(-1.0, ~discharges), "discharge": direction(1.0, discharges), "beside": beside}
