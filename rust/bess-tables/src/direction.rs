//! The two directions of power.

/// Direction of power of one interval. It is common to all strings and known from the sign of the demand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// From the grid.
    Charge,
    /// To the grid.
    Discharge,
}

impl Direction {
    /// Direction of a power, positive in discharge; zero counts as discharge.
    #[inline]
    pub fn of(power: f64) -> Self {
        if power < 0.0 {
            Self::Charge
        } else {
            Self::Discharge
        }
    }

    /// Sign of its powers: 1 in discharge, -1 in charge.
    #[inline]
    pub fn sign(self) -> f64 {
        self.pick(-1.0, 1.0)
    }

    /// Selects the value of this direction.
    #[inline(always)]
    pub fn pick<T>(self, charge: T, discharge: T) -> T {
        match self {
            Self::Charge => charge,
            Self::Discharge => discharge,
        }
    }
}
