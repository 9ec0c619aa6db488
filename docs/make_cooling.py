"""Write the tables of ``cooling.md``: ``python docs/make_cooling.py``, some seconds."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tables import markdown_table

import bess

DOCS = Path(__file__).parent
FILES = ("cooling-hot.md", "cooling-cool.md", "cooling-model.md")
ROOM = {"heat_capacity_kj_k": 2000.0, "wall_w_k": 60.0}
CIRCUIT = {"heat_capacity_kj_k": 200.0, "wall_w_k": 10.0}
STRONG = {"u_w_m2k": 10.0, "flow_kg_s": 0.066}
KINDS: dict[str, dict[str, Any]] = {
    "air, reference pack": {"kind": "air", "supply_c": 20.0, "loop": ROOM},
    "air, strong": {"kind": "air", "supply_c": 20.0, "loop": ROOM, **STRONG},
    "air, strong, fans by temperature": {
        "kind": "air", "supply_c": 20.0, "loop": ROOM, **STRONG,
        "start_c": 30.0, "variable_flow": True, "flow_steps": [0.2],
    },
    "liquid": {"kind": "liquid", "loop": CIRCUIT},
    "hybrid": {"kind": "hybrid", "loop": CIRCUIT},
}  # fmt: skip
WEEKS = {"hot": (35.0, 7.0), "cool": (5.0, 5.0)}
"""Mean and amplitude of the ambient temperature [degC]; warmest at 15 h."""
TOTAL = "auxiliaries, % of discharged"
COLD = "of which for cold, %"
"""The same with fans and pumps that take nothing, so that their heat is not cooled away either."""
PUBLISHED_POINTS = 1.5
"""What hybrid cooling saves as published, the lesser of two."""
FREE_COOLING = 0.03
"""Power of free cooling per heat that it carries off, the default of ``[cooling]``."""
DAYS = 7
SHARE = 0.65


def main() -> None:
    """Write the tables."""
    for name, text in tables().items():
        (DOCS / "_cases" / name).write_text(text, encoding="utf-8")


def tables() -> dict[str, str]:
    """Text of each file."""
    weeks = {week: week_of(week) for week in WEEKS}
    made = {f"cooling-{week}.md": _table(rows) + "\n" + reading(rows) for week, rows in weeks.items()}
    return {**made, "cooling-model.md": _model_table()}


def saved_points(rows: dict[str, dict[str, float]]) -> dict[str, float]:
    """Auxiliaries of each kind of air less those of the hybrid, in points of the energy discharged."""
    own = {kind: values[TOTAL] for kind, values in rows.items()}
    return {kind: value - own["hybrid"] for kind, value in own.items() if kind.startswith("air")}


def reading(rows: dict[str, dict[str, float]]) -> str:
    """What the hybrid saves, and on what."""
    points = [f"{value:.1f} points against *{kind}*" for kind, value in saved_points(rows).items()]
    moving = [f"{values[TOTAL] - values[COLD]:.2f} (*{kind}*)" for kind, values in rows.items()]
    controlled, hybrid = rows["air, strong, fans by temperature"], rows["hybrid"]
    text = (
        f"The hybrid saves {', '.join(points[:-1])} and {points[-1]}. Moving air or coolant takes "
        f"{', '.join(moving)}; the rest makes cold."
    )
    if controlled[TOTAL] < PUBLISHED_POINTS:
        return text + "\n"
    free = FREE_COOLING * hybrid["battery loss, % of discharged"] + hybrid[TOTAL] - hybrid[COLD]
    return (
        f"{text} To save {PUBLISHED_POINTS} points against the {controlled[TOTAL]:.2f} of fans by "
        f"temperature, a hybrid would have to make do with {controlled[TOTAL] - PUBLISHED_POINTS:.2f}; "
        f"its pump and free cooling of all battery losses around the clock, no chiller, are {free:.2f}.\n"
    )


def week_of(name: str) -> dict[str, dict[str, float]]:
    """Key figures of each kind in one of the weeks: two cycles a day, two reference strings, equal split."""
    mean_c, amplitude_k = WEEKS[name]
    time = pd.date_range("2024-07-01", periods=96 * DAYS, freq="15min", tz="UTC")
    hour = np.asarray((time.hour + time.minute / 60.0), dtype=np.float64)
    charging = (hour < 4.25) | ((hour >= 11.0) & (hour < 15.25))
    discharging = ((hour >= 6.0) & (hour < 10.0)) | ((hour >= 17.5) & (hour < 21.5))
    power_kw = 2 * 92.0 * SHARE * (1.0 * discharging - 1.0 * charging)
    ambient_c = mean_c + amplitude_k * np.cos(2.0 * np.pi * (hour - 15.0) / 24.0)
    with tempfile.TemporaryDirectory() as folder:
        demand, weather = Path(folder) / "demand.csv", Path(folder) / "weather.csv"
        pd.DataFrame({"time": time, "power_kw": power_kw}).to_csv(demand, index=False)
        pd.DataFrame({"time": time, "temperature_c": ambient_c}).to_csv(weather, index=False)
        return {
            kind: _figures(cooling, demand, weather)
            | {COLD: _figures({**cooling, "pressure_pa": 0.0}, demand, weather)[TOTAL]}
            for kind, cooling in KINDS.items()
        }


def _figures(cooling: dict[str, Any], demand: Path, weather: Path) -> dict[str, float]:
    study = bess.load_study(
        "case1",
        {
            "demand.file": str(demand),
            "weather.file": str(weather),
            "policy.name": "equal",
            "system.initial_soc": 0.05,
            "system.initial_temperature_c": 30.0,
            "system.parameters.cooling": cooling,
        },
    )
    figures = bess.run(study, progress=False).kpis
    return {
        TOTAL: 100.0 * figures["auxiliary_kwh"] / figures["discharged_kwh"],
        "not delivered, %": 100.0 * figures["undelivered_kwh"] / figures["demand_kwh"],
        "battery loss, % of discharged": 100.0 * figures["battery_loss_kwh"] / figures["discharged_kwh"],
        "system efficiency, %": figures["system_efficiency_pct"],
        "with auxiliaries, %": figures["system_efficiency_with_auxiliaries_pct"],
        "round trip, %": figures["round_trip_efficiency_pct"],
        "warmest string, °C": figures["peak_string_temperature_c"],
    }


def _table(rows: dict[str, dict[str, float]]) -> str:
    first, *others = next(iter(rows.values()))
    names = [first, COLD, *(name for name in others if name != COLD)]
    table = [["", *names]]
    for kind, values in rows.items():
        digits = [1 if "°C" in name else 2 for name in names]
        table.append([kind, *(f"{values[name]:.{n}f}" for name, n in zip(names, digits, strict=True))])
    return markdown_table(table)


def _model_table() -> str:
    """What the controller's lumped model of each kind is, as the plant shows it."""
    rows = [
        ["", "k1 [K/MJ]", "k2 [1/h]", "cools to [°C] at ambient 5", "at 20", "at 35", "error of a step [K]"]
    ]
    for kind, cooling in {"air, open": {"kind": "air"}, **KINDS}.items():
        document = bess.System.reference(1).document | {"cooling": cooling}
        system = bess.System(document)
        assert system.lumped is not None
        k1, k2 = 1e6 * system.lumped.k1_k_per_j[0], 3600.0 * system.lumped.k2_per_s[0]
        towards = [f"{value:.1f}" for value in system.surroundings_c(np.array([5.0, 20.0, 35.0]))]
        error_k = f"{system.lumped.error_k[0]:.3f}"
        rows.append([kind, f"{k1:.3f}", f"{k2:.4f}", *towards, error_k])
    return markdown_table(rows)


if __name__ == "__main__":
    main()
