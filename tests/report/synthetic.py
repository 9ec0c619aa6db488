"""Records of the shape of a run, by a small model of their own: plausible to look at, quick for a year."""

import numpy as np
import xarray as xr

import bess

NOMINAL_KW = 92.0
ENERGY_KWH = 266.0


def record(
    n_strings: int = 2,
    steps: int = 192,
    *,
    concentrate: float = 0.5,
    nodes: int = 0,
    price: bool = False,
    seed: int = 0,
) -> xr.Dataset:
    """Two cycles a day; ``concentrate`` = 1 gives all power to few strings, 0 shares it equally."""
    rng = np.random.default_rng(seed)
    day = np.repeat(
        [-78, -30, 0, 78, 30, 0, -78, -30, 0, 78, 30, 0, -78, 0],
        [10, 2, 2, 19, 3, 2, 20, 3, 2, 19, 3, 2, 8, 1],
    )
    demand = np.resize(day, steps) * n_strings / 2.0
    soc, temperature = np.full(n_strings, 0.5), np.full(n_strings, 25.0)
    rows: dict[str, list] = {}
    was_on = np.zeros(n_strings, dtype=bool)
    for power in demand:
        order = np.argsort(soc if power < 0 else -soc)
        greedy = np.zeros(n_strings)
        left = abs(power)
        for string in order:
            greedy[string] = min(left, NOMINAL_KW)
            left -= greedy[string]
        request = concentrate * greedy + (1 - concentrate) * abs(power) / n_strings
        factor = np.clip(1 - 0.06 * np.maximum(temperature - 45, 0), 0, 1)
        derated = (1 - factor) * request
        room = np.maximum((1 - soc if power < 0 else soc) * ENERGY_KWH / 0.25, 0)
        delivered = np.minimum(request - derated, room)
        on = delivered > 0
        inverter = np.where(on, 1.1 + 0.0065 * delivered, 0)
        heat = 2.2 * (delivered / NOMINAL_KW) ** 2 * np.exp(-0.018 * (temperature - 25))
        sign = np.sign(power)
        soc = np.clip(soc - sign * 0.25 * (delivered + sign * (inverter + heat)) / ENERGY_KWH, 0, 1)
        temperature = temperature + 0.558 * heat * 3 - 0.0125 * (temperature - 25)
        values = {
            "request_kw": sign * request, "delivered_kw": sign * delivered, "derating_loss_kw": derated,
            "availability_loss_kw": request - derated - delivered, "inverter_loss_kw": inverter,
            "battery_loss_kw": heat, "hysteresis_loss_kw": 0.002 * delivered,
            "chemical_kw": sign * delivered + inverter + heat + 0.002 * delivered, "standby_kw": 0.0 * heat,
            "current_a": sign * delivered / 0.7, "soc": soc,
            "soh_capacity": np.ones(n_strings), "soh_resistance": np.ones(n_strings), "wear_eur": 0.0 * heat,
            "temperature_c": temperature, "node_max_c": temperature + 1.5, "derating_factor": factor,
            "limits": np.zeros(n_strings, dtype=int), "inverter_starts": (on & ~was_on).astype(int),
        }  # fmt: skip
        was_on = on
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
    variables: dict = {name: (("time", "string"), np.array(value)) for name, value in rows.items()}
    gap = rng.lognormal(-7, 1.5, steps)
    variables |= {
        "demand_kw": ("time", demand.astype(float)), "unmet_kw": ("time", np.zeros(steps)),
        "ambient_c": ("time", np.full(steps, 25.0)),
        "ledger_residual_kwh": ("time", rng.normal(0, 1e-12, steps)),
        "solver_status": ("time", np.ones(steps, dtype=int)), "solver_gap": ("time", gap),
        "solver_search_gap": ("time", gap / 3), "solver_nodes": ("time", rng.poisson(4, steps)),
        "fallback": ("time", (np.arange(steps) % 97 == 50).astype(int)),
    }  # fmt: skip
    if price:
        hour = np.arange(steps) / 4.0
        wave = 80 - 45 * np.cos(2 * np.pi * hour / 12) + rng.normal(0, 6, steps)
        variables["price_eur_mwh"] = ("time", wave)
    if nodes:
        along = np.linspace(-1.5, 1.5, nodes)
        field = np.array(rows["temperature_c"])[:, :, None] + along * 0.1 * (
            np.array(rows["temperature_c"])[:, :, None] - 25
        )
        variables["node_temperature_c"] = (("time", "string", "node"), field.astype("f4"))
    time = np.datetime64("2024-01-01T00:00", "ns") + np.arange(steps) * np.timedelta64(15, "m")
    return xr.Dataset(
        variables,
        {"time": time, "string": np.arange(n_strings)},
        {
            "initial_soc": np.full(n_strings, 0.5),
            "initial_temperature_c": np.full(n_strings, 25.0),
            "step_h": np.float64(0.25),
        },
    )


def with_reserve(dataset: xr.Dataset) -> xr.Dataset:
    """The same plant selling a reserve, a tenth of which is not there, and never asked by the frequency."""
    steps = dataset.sizes["time"]
    extra = {
        "response_kw": 0.0,
        "capacity_kw": 100.0,
        "capacity_able_kw": 90.0,
        "capacity_price_eur_mw_h": 40.0,
    }
    added = {name: ("time", np.full(steps, value)) for name, value in extra.items()}
    return dataset.assign(added)


def kpis(dataset: xr.Dataset) -> dict[str, float]:
    """What ``bess.kpis`` makes of such a record."""
    return dict(bess.kpis(dataset))
