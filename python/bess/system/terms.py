"""Section ``[settlement]``: terms in addition to the market price, used by both dispatch and settlement."""

from typing import Annotated, TypeVar

from bess.arrays import Array
from bess.system.quantities import NonNegative, within
from bess.system.section import PublicSection

Price = TypeVar("Price", float, Array)


class SettlementTerms(PublicSection):
    """Prices other than energy prices: section ``[settlement]`` of a study with prices.

    Attributes
    ----------
    shortfall_eur_mwh : float
        Cost per MWh of undelivered energy, in addition to the magnitude of its price.
    charge_fee_eur_mwh, discharge_fee_eur_mwh : float
        Fees and taxes on each MWh charged and discharged (AC).
    start_eur : float
        For each start of an inverter.
    discount_rate : float
        Discount rate per year, for the net present value of runs over years.
    capacity_penalty : float
        Penalty for reserve that is sold but not sustained, relative to its price: 2 cancels the revenue and
        costs the same amount again.
    """

    shortfall_eur_mwh: NonNegative = 50.0
    charge_fee_eur_mwh: NonNegative = 0.0
    discharge_fee_eur_mwh: NonNegative = 0.0
    start_eur: NonNegative = 0.0
    discount_rate: Annotated[float, within(0.0, 1.0, "per year")] = 0.05
    capacity_penalty: NonNegative = 2.0

    @property
    def fees_eur_mwh(self) -> tuple[float, float]:
        """Return the fees on charged and on discharged energy."""
        return self.charge_fee_eur_mwh, self.discharge_fee_eur_mwh

    def shortfall_price_eur_mwh(self, price_eur_mwh: Price) -> Price:
        """Return the cost of undelivered energy per MWh, in either direction."""
        return abs(price_eur_mwh) + self.shortfall_eur_mwh

    def charge_price_eur_mwh(self, price_eur_mwh: Price) -> Price:
        """Return the cost of charging per MWh."""
        return price_eur_mwh + self.charge_fee_eur_mwh

    def discharge_price_eur_mwh(self, price_eur_mwh: Price) -> Price:
        """Return the revenue of discharging per MWh, before wear."""
        return price_eur_mwh - self.discharge_fee_eur_mwh
