"""Write the tables and the figure of ``ageing.md``: ``python docs/make_ageing.py``, a few seconds."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tables import markdown_table, save_picture

import bess
from bess._core import ageing_models
from bess.control import wear
from bess.report.drawing.style import DOUBLE_COLUMN_IN, PALETTE, styled

DOCS = Path(__file__).parent
MODELS = dict(ageing_models())
TEMPERATURES_C = (15.0, 25.0, 35.0, 45.0)
DAYS, DEPTH, C_RATE = 3650, 0.8, 0.35


def main() -> None:
    """Write everything."""
    for name, text in tables().items():
        (DOCS / "_cases" / name).write_text(text, encoding="utf-8")
    save_picture(_figure(), "ageing-prices")


def tables() -> dict[str, str]:
    """Tables by their files: the models, what they lose in ten years, what wear costs after three."""
    models = [["name", "cell, range and source"], *([f"`{name}`", text] for name, text in MODELS.items())]
    lost = [["model", *(f"{t:g} °C" for t in TEMPERATURES_C)]]
    cycles = [(depth, t) for t in (25.0, 40.0) for depth in (0.4, 0.8)]
    prices = [["model", *(f"depth {d:g}, {t:g} °C" for d, t in cycles), "a day, 25 °C", "a day, 40 °C"]]
    for model in MODELS:
        causes = zip(100.0 * _standing(model), 100.0 * _cycling(model), strict=True)
        lost.append([f"`{model}`", *(f"{a + b:.0f} ({a:.0f} + {b:.0f})" for a, b in causes)])
        now = _after_three_years(model)
        cycle_ct = [100.0 * now.cycling_eur_kwh(d, t, c_rate=C_RATE)[0, 0] for d, t in cycles]
        day_ct = [
            100.0 * now.calendar_eur_day(0.5, t)[0, 0] / now.nominal_energy_kwh[0] for t in (25.0, 40.0)
        ]
        prices.append([f"`{model}`", *(f"{value:.1f}" for value in [*cycle_ct, *day_ct])])
    named = {"models": models, "ten-years": lost, "prices": prices}
    return {f"ageing-{name}.md": markdown_table(rows) for name, rows in named.items()}


def _system(model: str, **battery: float) -> bess.System:
    """One string that makes hardly any heat, so that it stays at the temperature of the air."""
    document = bess.System.reference(1).document
    document["battery"] = document["battery"] | {"r_scale": 1e-9} | battery
    document["inverter"] = document["inverter"] | {"nominal_kw": 100.0}
    return bess.System(document | {"wear": {"model": model}})


def _fleet(model: str, plant_step_s: float, **battery: float) -> bess.PlantEnsemble:
    states = [bess.State([0.5], [temperature_c]) for temperature_c in TEMPERATURES_C]
    return bess.PlantEnsemble(_system(model, **battery), states, plant_step_s=plant_step_s)


def _run(fleet: bess.PlantEnsemble, request_kw: NDArray[np.float64], step_s: float) -> bess.plant.Flows:
    ambient_c = np.repeat(np.array(TEMPERATURES_C)[:, None], request_kw.shape[1], axis=1)
    return fleet.run(request_kw[:, :, None], step_s, ambient_c=ambient_c)


def _standing(model: str, days: int = DAYS) -> NDArray[np.float64]:
    flows = _run(_fleet(model, 900.0), np.zeros((len(TEMPERATURES_C), 4 * days)), 21_600.0)
    return flows.calendar_loss[:, -1, 0]


def _cycling(model: str, days: int = DAYS) -> NDArray[np.float64]:
    """One equivalent full cycle a day between SOC 0.1 and 0.9; power follows the capacity that is left."""
    half_cycle_s = DEPTH / C_RATE * 3600.0
    fleet = _fleet(model, half_cycle_s / 60.0, soc_min=0.1, soc_max=0.9)
    cycles = np.tile(np.repeat([-100.0, 100.0], 10), 25)
    for _ in range(round(days / DEPTH / 25)):
        left = np.array([state.soh_capacity for state in fleet.states])
        flows = _run(fleet, left * cycles, half_cycle_s / 10.0)
    return flows.cyclic_loss[:, -1, 0]


def _after_three_years(model: str) -> wear.MarginalWear:
    """Prices of a string that has stood and cycled for three years at 25 degC."""
    at = TEMPERATURES_C.index(25.0)
    calendar, cyclic = _standing(model, 1095)[at], _cycling(model, 1095)[at]
    system = _system(model)
    state = bess.State([0.5], [25.0], [1.0 - calendar - cyclic], cyclic_loss=[cyclic])
    return wear.marginal(system, state)


@styled()
def _figure() -> Figure:
    """Price of a kWh discharged over temperature and over depth, after three years."""
    figure = Figure(figsize=(DOUBLE_COLUMN_IN, 2.4), layout="constrained")
    over_temperature, over_depth = figure.subplots(1, 2, sharey=True)
    temperature_c, depth = np.linspace(10.0, 45.0, 36), np.linspace(0.05, 1.0, 39)
    for model, colour in zip(MODELS, PALETTE, strict=False):
        if model == "schmalstieg":  # ten times the others
            continue
        now = _after_three_years(model)
        over_temperature.plot(
            temperature_c,
            100.0 * now.cycling_eur_kwh(DEPTH, temperature_c, c_rate=C_RATE)[0],
            color=colour,
            label=model,
        )
        over_depth.plot(depth, 100.0 * now.cycling_eur_kwh(depth, 25.0, c_rate=C_RATE)[0], color=colour)
    over_temperature.set(xlabel="Temperature (°C), depth 0.8", ylabel="ct per kWh discharged")
    over_depth.set(xlabel="Depth of cycle, 25 °C", ylim=(0.0, None))
    over_temperature.legend()
    return figure


if __name__ == "__main__":
    main()
