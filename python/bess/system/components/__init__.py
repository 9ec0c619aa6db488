"""Cells and inverters: measured tables into the format of a system file, and a small bundled library."""

from bess.system.components.cell_files import read_ocv, read_resistance
from bess.system.components.inverter_files import read_inverter
from bess.system.components.loss_table import LossTable
from bess.system.components.losses import (
    inverter_from_efficiency,
    inverter_from_loss,
    inverter_from_sandia,
)
from bess.system.components.registry import (
    Entry,
    cell_tables,
    inverter_section,
    list_cells,
    list_inverters,
    list_systems,
)

__all__ = [
    "Entry",
    "LossTable",
    "cell_tables",
    "inverter_from_efficiency",
    "inverter_from_loss",
    "inverter_from_sandia",
    "inverter_section",
    "list_cells",
    "list_inverters",
    "list_systems",
    "read_inverter",
    "read_ocv",
    "read_resistance",
]
