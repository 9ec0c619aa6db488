"""The complete state of a plant, for checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.arrays import ByValue


@dataclass(frozen=True, eq=False)
class PlantSnapshot(ByValue):
    """Complete state of a plant; a restored plant continues to the last bit.

    The fields are plain arrays, so a checkpoint can store them by name and rebuild the snapshot. A
    :class:`~bess.plant.PlantEnsemble` has the scenario as an additional leading axis.

    Attributes
    ----------
    soc : ndarray, shape (n_strings,)
        State of charge.
    node_temperature_c : ndarray, shape (n_strings, n_nodes)
        Node temperatures [degC]; padded with NaN for strings with fewer nodes.
    derating_integral_k : ndarray, shape (n_strings,)
        Integral of the PI derating law [K, per 15 min]; 0 under the table law.
    inverter_on : ndarray of bool, shape (n_strings,)
        Whether each inverter was on at the end of the last plant step.
    ageing : ndarray, shape (n_strings, n_numbers)
        Ageing state: losses, damages, and open cycles. Rows are padded with 0 to the length of the string
        with the most open cycles.
    cooling_stages : ndarray, shape (n_strings,), or None
        Active flow stages; None for a plant without section ``[cooling]``.
    coolant : ndarray, shape (2,), or None
        1 if the chiller may run, else 0, and the temperature of the common loop [degC].
    """

    soc: NDArray[np.float64]
    node_temperature_c: NDArray[np.float64]
    derating_integral_k: NDArray[np.float64]
    inverter_on: NDArray[np.bool_]
    ageing: NDArray[np.float64]
    cooling_stages: NDArray[np.float64] | None = None
    coolant: NDArray[np.float64] | None = None
