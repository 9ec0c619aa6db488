"""The complete state of a plant, for checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.numbers import ByValue


@dataclass(frozen=True, eq=False)
class PlantSnapshot(ByValue):
    """Everything a plant remembers: one that is restored to it continues bit by bit.

    The fields are plain arrays, so a checkpoint may store them by name and build the snapshot again from
    them. A :class:`~bess.plant.Fleet` has the scenario as one more leading axis.

    Attributes
    ----------
    soc : ndarray, shape (n_strings,)
        State of charge.
    node_temperature_c : ndarray, shape (n_strings, n_nodes)
        Node temperatures [degC]; NaN beyond the nodes of a string that has fewer than others.
    derating_integral_k : ndarray, shape (n_strings,)
        Integral of the PI derating law [K, per 15 min]; 0 under the table law.
    inverter_on : ndarray of bool, shape (n_strings,)
        Whether each inverter ran at the end of the last plant step.
    ageing : ndarray, shape (n_strings, n_numbers)
        What ageing remembers: losses, damages, and the cycles that are still open. As many numbers as the
        string with the most open cycles needs, the others filled up with 0.
    cooling_stages : ndarray, shape (n_strings,), or None
        Stages of flow that are on; None for a plant without section ``[cooling]``.
    coolant : ndarray, shape (2,), or None
        1 where the chiller may run, and the temperature of the common loop [degC].
    """

    soc: NDArray[np.float64]
    node_temperature_c: NDArray[np.float64]
    derating_integral_k: NDArray[np.float64]
    inverter_on: NDArray[np.bool_]
    ageing: NDArray[np.float64]
    cooling_stages: NDArray[np.float64] | None = None
    coolant: NDArray[np.float64] | None = None
