"""Conversion of capacity loss, or of energy, to EUR."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from bess.arrays import Array, ByValue
from bess.system import System
from bess.units import KWH_PER_MWH


@dataclass(frozen=True, eq=False)
class WearPrices(ByValue):
    """Wear prices of every string, arrays of shape ``(n_strings,)``.

    Attributes
    ----------
    eur_per_loss : ndarray
        Cost of a loss of the whole nameplate capacity [EUR]: ``replacement_eur_kwh * nominal energy /
        (1 - end_of_life)``. Ageing from new to end of life thus costs one replacement. 0 for strings without
        a cell model.
    eur_per_kwh_discharged : ndarray
        Price of a kWh discharged (AC) [EUR/kWh]; 0 for strings whose model is not ``throughput``.
    end_of_life : ndarray
        State of health of the capacity at which a string is replaced.
    """

    eur_per_loss: Array
    eur_per_kwh_discharged: Array
    end_of_life: Array

    @classmethod
    def of(cls, system: System) -> Self:
        """Take the prices from the sections ``[wear]`` of the strings."""
        wears = [string.wear for string in system.strings]
        end_of_life = np.array([wear.end_of_life for wear in wears])
        replacement = np.array([wear.replacement_eur_kwh if wear.cell_model else 0.0 for wear in wears])
        by_energy = [wear.eur_per_mwh if wear.model == "throughput" else 0.0 for wear in wears]
        return cls(
            eur_per_loss=replacement * system.nominal_energy_kwh / (1.0 - end_of_life),
            eur_per_kwh_discharged=np.array(by_energy) / KWH_PER_MWH,
            end_of_life=end_of_life,
        )

    def cost_eur(self, lost: Array, discharged_kwh: Array) -> Array:
        """Return the cost [EUR] of capacity losses (shares of the nameplate) and discharged energy [kWh]."""
        return lost * self.eur_per_loss + discharged_kwh * self.eur_per_kwh_discharged
