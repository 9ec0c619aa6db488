"""Capacity laws of the cell models as published, in plain numpy: days, cycles, kelvin, fractions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

GAS_CONSTANT = 8.3144598


@dataclass(frozen=True)
class Law:
    """``y = rate x^exponent``."""

    rate: float
    exponent: float

    def loss(self, x: float) -> float:
        return float(self.rate * x**self.exponent)

    def slope(self, x: float) -> float:
        return float(self.rate * self.exponent * x ** (self.exponent - 1.0))


def anode_v(soc: float) -> float:
    x = 0.0085 + soc * 0.7715
    return float(
        0.6379
        + 0.5416 * np.exp(-305.5309 * x)
        + 0.044 * np.tanh(-(x - 0.1958) / 0.1088)
        - 0.1978 * np.tanh((x - 1.0571) / 0.0854)
        - 0.6875 * np.tanh((x + 0.0117) / 0.0529)
        - 0.0175 * np.tanh((x - 0.5692) / 0.0875)
    )


def kokam(t_c: float, soc: float, depth: float, c: float) -> tuple[Law, Law]:
    t, u = (t_c + 273.15) / 308.15, anode_v(soc) / 0.123
    calendar = 2.66e7 * np.exp(-17.8 / t) * np.exp(-5.21 * u / t)
    return Law(calendar, 0.357), Law(3.80e3 * np.exp(-18.4 / t) * np.exp(1.04 * np.exp(depth**2)), 0.778)


def nmc_a(t_c: float, soc: float, depth: float, c: float) -> tuple[Law, Law]:
    t, u = (t_c + 273.15) / 308.15, anode_v(soc) / 0.123
    calendar = 8.71e-7 * np.exp(10.0 * t**3 / u ** (1 / 3)) / 1000.0**0.578
    cyclic = abs(
        0.0267
        + 1.64 * t**3 * np.sqrt(depth)
        + 0.011 * np.exp(c**2 / np.sqrt(t))
        - 0.44 * np.exp(np.sqrt(depth) * t**2 * np.sqrt(c))
    )
    return Law(calendar, 0.578), Law(cyclic / 1e4**1.11, 1.11)


def naumann(t_c: float, soc: float, depth: float, c: float) -> tuple[Law, Law]:
    arrhenius = np.exp(-17126.0 / GAS_CONSTANT * (1.0 / (t_c + 273.15) - 1.0 / 298.15))
    calendar = 1.2571e-5 * arrhenius * (2.8575 * (soc - 0.5) ** 3 + 0.60225) * np.sqrt(86400.0)
    return Law(calendar, 0.5), Law(
        (0.0630 * c + 0.0971) * (4.0253 * (depth - 0.6) ** 3 + 1.0923) / 100.0, 0.5
    )


Model = Callable[[float, float, float, float], tuple[Law, Law]]
PUBLISHED: dict[str, Model] = {"kokam-75ah": kokam, "nmc-a-75ah": nmc_a, "naumann-lfp": naumann}
