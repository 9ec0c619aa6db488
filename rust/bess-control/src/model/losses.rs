//! The four kinds of loss.

/// One number for each kind of loss: a power [W] or a price [1/W].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Losses {
    /// Undelivered because of SOC limits or no real root of the current.
    pub availability: f64,
    /// Undelivered because of temperature derating.
    pub derating: f64,
    /// Inverter loss.
    pub inverter: f64,
    /// Battery loss (heat).
    pub battery: f64,
}

impl Losses {
    /// In the order availability, derating, inverter, battery.
    pub fn from_array([availability, derating, inverter, battery]: [f64; 4]) -> Self {
        Self { availability, derating, inverter, battery }
    }

    /// One element for each four values, in the order of [`Self::from_array`].
    pub fn rows(values: &[f64]) -> Vec<Self> {
        values.chunks_exact(4).map(|c| Self::from_array([c[0], c[1], c[2], c[3]])).collect()
    }

    /// In the order availability, derating, inverter, battery.
    pub fn to_array(self) -> [f64; 4] {
        [self.availability, self.derating, self.inverter, self.battery]
    }

    /// Cost of these powers at these prices.
    #[inline]
    pub fn cost(&self, prices: &Self) -> f64 {
        prices.availability * self.availability
            + prices.derating * self.derating
            + prices.inverter * self.inverter
            + prices.battery * self.battery
    }

    /// Whether any loss other than availability has a cost.
    pub(crate) fn any_while_running(&self) -> bool {
        self.derating > 0.0 || self.inverter > 0.0 || self.battery > 0.0
    }
}
