//! The four kinds of loss.

/// One number for each kind of loss: a power [W], or what a watt of it costs [1/W].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Losses {
    /// Asked for and not deliverable: full, empty, or no real root of the current.
    pub availability: f64,
    /// Asked for and not delivered because the string is warm.
    pub derating: f64,
    /// Lost in the inverter.
    pub inverter: f64,
    /// Heat in the battery.
    pub battery: f64,
}

impl Losses {
    /// In the order availability, derating, inverter, battery.
    pub fn from_array([availability, derating, inverter, battery]: [f64; 4]) -> Self {
        Self { availability, derating, inverter, battery }
    }

    /// One of each four values, in the order of [`Self::from_array`].
    pub fn rows(values: &[f64]) -> Vec<Self> {
        values.chunks_exact(4).map(|c| Self::from_array([c[0], c[1], c[2], c[3]])).collect()
    }

    /// In the order availability, derating, inverter, battery.
    pub fn to_array(self) -> [f64; 4] {
        [self.availability, self.derating, self.inverter, self.battery]
    }

    /// What these powers cost at these prices.
    #[inline]
    pub fn cost(&self, prices: &Self) -> f64 {
        prices.availability * self.availability
            + prices.derating * self.derating
            + prices.inverter * self.inverter
            + prices.battery * self.battery
    }

    /// Whether any of what flows costs something: all kinds but availability.
    pub(crate) fn any_while_running(&self) -> bool {
        self.derating > 0.0 || self.inverter > 0.0 || self.battery > 0.0
    }
}
