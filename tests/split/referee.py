"""An independent referee of the power split: the control model in plain NumPy, and exhaustive search over it.

Written from the equations (see the docstring of each function), not from the package: it reads the system's
parameter sections and shares no code with the optimiser or the Rust core. Two strings; ``share`` is
the part of the demand asked of string 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import bess

KW = 1e3


@dataclass(frozen=True)
class StringModel:
    """String-level tables of one string, SI units."""

    parameters: object

    @property
    def nominal_w(self) -> float:
        return self.parameters.inverter.nominal_kw * KW

    def tables(self, sign: float) -> tuple[np.ndarray, np.ndarray]:
        inverter = self.parameters.inverter
        loss = inverter.loss_discharge if sign > 0 else inverter.loss_charge
        return np.array(inverter.load) * self.nominal_w, np.array(loss) * self.nominal_w

    def coefficients(self, sign: float, soc: np.ndarray, tau: np.ndarray):
        """``k = K(tau)``, ``V = OCV(soc)``, ``R = f_T(tau)``, times ``f_soc(soc) / f_T(25)`` below the
        switch."""
        battery, derating = self.parameters.battery, self.parameters.derating
        ocv = battery.ocv_v.discharge[0] if sign > 0 else battery.ocv_v.charge[0]
        k = np.interp(tau, derating.temperature_c, derating.factor)
        v = np.interp(soc, battery.ocv_v.soc, ocv) * battery.cells_series
        f_t = battery.resistance_temperature
        r = np.interp(tau, f_t.temperature_c, f_t.resistance_mohm)
        f_soc = battery.resistance_soc
        factor = np.interp(soc, f_soc.soc, f_soc.resistance_mohm) / np.interp(
            25.0, f_t.temperature_c, f_t.resistance_mohm
        )
        r = np.where(soc < battery.low_soc_switch, r * factor, r)
        return k, v, r * 1e-3 * battery.r_scale * battery.cells_series / battery.cells_parallel

    def step(self, sign, soc, tau, request_w, ambient_c, dt_h):
        """One interval of the control model; returns ``(a, d, w, h)`` in W and the next ``soc, tau``."""
        battery, thermal = self.parameters.battery, self.parameters.thermal.lumped
        capacity_ah = battery.cell_capacity_ah * battery.cells_parallel
        k, v, r = self.coefficients(sign, soc, tau)
        d = (1.0 - k) * request_w
        wanted = request_w - d
        load, loss = self.tables(sign)
        if sign > 0:  # V I - R I^2 = p + w(p), up to the empty string or the root's end
            current = np.minimum(np.maximum(soc - battery.soc_min, 0.0) * capacity_ah / dt_h, v / (2.0 * r))
            if battery.cell_voltage_min_v is not None:
                room_v = np.maximum(v - battery.cell_voltage_min_v * battery.cells_series, 0.0)
                current = np.minimum(current, room_v / r)
            internal = v * current - r * current**2
            limit = np.where(internal < loss[0], 0.0, np.interp(internal, load + loss, load))
        else:  # V I + R I^2 = p - w(p), up to the full string
            current = np.maximum(battery.soc_max - soc, 0.0) * capacity_ah / dt_h
            if battery.cell_voltage_max_v is not None:
                room_v = np.maximum(battery.cell_voltage_max_v * battery.cells_series - v, 0.0)
                current = np.minimum(current, room_v / r)
            internal = v * current + r * current**2
            limit = np.interp(internal, load - loss, load)
        p = np.minimum(wanted, limit)
        p = np.where(p < self.parameters.inverter.min_power_kw * KW, 0.0, p)
        a = wanted - p
        w = np.where(p > 0.0, np.interp(p, load, loss), 0.0)
        if sign > 0:
            root = np.sqrt(np.maximum(v**2 - 4.0 * r * (p + w), 0.0))
            current = np.where(p > 0.0, (v - root) / (2.0 * r), 0.0)
        else:
            current = np.where(p > 0.0, (-v + np.sqrt(v**2 + 4.0 * r * (p - w))) / (2.0 * r), 0.0)
        h = r * current**2
        seconds = dt_h * 3600.0
        tau = tau + seconds * (thermal.k1_k_per_j * h - thermal.k2_per_s * (tau - ambient_c))
        return (a, d, w, h), soc - sign * current * dt_h / capacity_ah, tau


@dataclass(frozen=True)
class Referee:
    """Exhaustive search over the shares of two strings."""

    system: bess.System
    state: bess.State
    demand_kw: np.ndarray
    dt_h: float = 0.25

    @property
    def strings(self) -> list[StringModel]:
        return [StringModel(s) for s in self.system.strings]

    def losses(self, share: np.ndarray) -> np.ndarray:
        """Return the sums over strings and steps of ``a, d, w, h`` [kW], shape ``(4, batch)``, of ``(batch,
        steps)``."""
        request = np.stack([share, 1.0 - share], axis=1) * np.abs(self.demand_kw)
        return self.follow(request)

    def follow(self, request_kw: np.ndarray) -> np.ndarray:
        """The same for magnitudes of requests, ``(batch, strings, steps)``."""
        strings = self.strings
        soc = [np.full(request_kw.shape[0], s) for s in self.state.soc]
        tau = [np.full(request_kw.shape[0], t) for t in self.state.temperature_c]
        total = np.zeros((4, request_kw.shape[0]))
        for t, demand in enumerate(self.demand_kw):
            for m, string in enumerate(strings):
                flows, soc[m], tau[m] = string.step(
                    np.sign(demand),
                    soc[m],
                    tau[m],
                    request_kw[:, m, t] * KW,
                    self.system.ambient_c,
                    self.dt_h,
                )
                total += np.array(flows)
        return total / KW

    def objective(self, losses: np.ndarray, weights: tuple[float, float, float]) -> np.ndarray:
        """Blended second group: derating, inverter, battery, each over its value at nominal power."""
        n = len(self.strings) * self.demand_kw.size
        string = self.strings[0]
        nominal_kw = string.nominal_w / KW
        inverter_kw = string.tables(-1.0)[1][-1] / KW
        _, v, r = string.coefficients(1.0, np.array(0.5), np.array(25.0))
        battery_kw = float(r * (string.nominal_w / v) ** 2) / KW
        scale = np.array([nominal_kw, inverter_kw, battery_kw])
        return (np.array(weights) / scale / n) @ losses[1:]

    def _shares(self, demand: float) -> tuple[float, float]:
        if demand == 0.0:
            return 0.0, 1.0
        nominal = [s.nominal_w / KW for s in self.strings]
        return max(0.0, 1.0 - nominal[1] / abs(demand)), min(1.0, nominal[0] / abs(demand))

    def best(
        self,
        weights: tuple[float, float, float],
        points: int = 9,
        tolerance_kw: float = 0.005,
        ceiling_kw: float | None = None,
    ) -> tuple[float, float]:
        """Return the smallest availability loss [kW] and the smallest objective of what sheds at most
        ``ceiling_kw``: by default, ``tolerance_kw`` more than the smallest.

        A few watts of availability loss are worth several per mille of the objective, so that two schedules
        compare only under the same ceiling."""
        limits = np.array([self._shares(d) for d in self.demand_kw])
        axes = [np.linspace(low, high, points) for low, high in limits]
        grid = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
        losses = self.losses(grid)
        least = np.inf
        for stage in ("availability", "objective"):

            def merit(losses: np.ndarray, stage: str = stage, least: float = least) -> np.ndarray:
                value = self.objective(losses, weights)
                if stage == "availability":
                    return losses[0] + 1e-3 * value
                ceiling = least + tolerance_kw if ceiling_kw is None else ceiling_kw
                return value + 1e3 * np.maximum(losses[0] - ceiling, 0.0)

            if stage == "availability" and losses[0].min() == 0.0:
                least = 0.0
                continue
            found = self._refine(grid, merit, limits, 1.0 / (points - 1))
            if stage == "availability":
                least = float(self.losses(found)[0].min())
            else:
                value = merit(self.losses(found))
            grid = np.concatenate([grid, found])
        return least, float(value.min())

    def _refine(self, grid, merit, limits, width, starts: int = 6) -> np.ndarray:
        """Zoom in on the best points of the grid; both ends of each share stay candidates in every round."""
        order = np.argsort(merit(self.losses(grid)), kind="stable")
        centres = grid[order[:starts]]
        span = limits[:, 1] - limits[:, 0]
        steps = grid.shape[1]
        offsets = np.stack(
            [g.ravel() for g in np.meshgrid(*[[-0.5, 0.0, 0.5]] * steps, indexing="ij")], axis=1
        )
        ends = np.stack(
            [np.where(np.arange(steps) == t, limits[t, e], np.nan) for t in range(steps) for e in (0, 1)]
        )
        for _ in range(10):
            near = centres[:, None, :] + width * span * offsets
            jump = np.where(np.isnan(ends), centres[:, None, :], ends)
            candidates = np.clip(np.concatenate([near, jump], axis=1), limits[:, 0], limits[:, 1])
            value = merit(self.losses(candidates.reshape(-1, steps))).reshape(candidates.shape[:2])
            centres = candidates[np.arange(len(candidates)), np.argmin(value, axis=1)]
            width *= 0.6
        return centres
