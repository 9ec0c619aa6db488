"""Mean temperature of the strings, and derating factor over temperature."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bess.report.charts.long_runs import curve
from bess.report.data import Results, TimeAxis, named, with_initial
from bess.report.drawing.chart import Chart, Panel, Series
from bess.report.drawing.style import INK, SINGLE_COLUMN_IN, colours, told_apart
from bess.system import System


def mean_temperature(results: Results, *, derating_start_c: float = 45.0) -> Chart:
    """Mean over strings of the temperature, for one result or several, with the start of derating [degC]."""
    datasets = named(results)
    lines: list[Series] = []
    label = ""
    for name, dataset, colour, dashed in told_apart(datasets):
        time = TimeAxis(dataset)
        label = time.label
        lines += curve(time, with_initial(dataset, "temperature_c").mean(axis=1), colour, name, dashed=dashed)
        ends = time.edges[[0, -1]]
    limit = np.full(2, derating_start_c)
    lines.append(Series(ends, limit, INK, f"derating starts, {derating_start_c:g} °C", dashed=True))
    return Chart(label, (Panel("Mean temperature (°C)", tuple(lines)),), panel_height_in=2.4)


def derating_curves(
    system: System, gains: Sequence[tuple[float, float]] | None = None, *, string: int = 0
) -> Chart:
    """Derating factor against temperature for several pairs of gains, and the table of the system.

    Parameters
    ----------
    system
        Its string ``string`` gives start and stop temperature, its own gains, and the table.
    gains
        Pairs ``(kp [1/K], ki [1/(K step)])``; half, once and twice the system's own if omitted.

    Notes
    -----
    Response of the PI law to a constant ramp of ``r`` K per control step,
    ``k = clip(1 - kp e - ki e^2 / (2 r), 0, 1)`` with ``e = T - T_start``. The ramp is the one at which the
    system's own gains reach zero exactly at ``stop_c``; without one, the integral part is left out.
    """
    law = system.strings[string].derating
    reach = law.stop_c - law.start_c
    left = 1.0 - law.kp_per_k * reach
    ramp = law.ki_per_k_step * reach**2 / (2.0 * left) if left > 0.0 and law.ki_per_k_step > 0.0 else np.inf
    if gains is None:
        gains = [(factor * law.kp_per_k, factor * law.ki_per_k_step) for factor in (0.5, 1.0, 2.0)]
    temperature = np.linspace(law.start_c - 5.0, law.stop_c + 10.0, 301)
    excess = np.maximum(temperature - law.start_c, 0.0)
    lines = [
        Series(
            temperature,
            np.clip(1.0 - kp * excess - ki * excess**2 / (2.0 * ramp), 0.0, 1.0),
            colour,
            f"Kₚ = {kp:.3g} 1/K, Kᵢ = {ki:.2g} 1/(K step)",
        )
        for (kp, ki), colour in zip(gains, colours(len(gains)), strict=True)
    ]
    lines.append(Series(np.array(law.temperature_c), np.array(law.factor), INK, "table in use", "dots"))
    return Chart(
        "String temperature (°C)",
        (Panel("Derating factor", tuple(lines), y_limits=(-0.03, 1.05)),),
        panel_height_in=2.5,
        width_in=SINGLE_COLUMN_IN,
    )
