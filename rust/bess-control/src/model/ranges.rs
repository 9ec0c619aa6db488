//! Ranges of the coefficients over boxes of states, taken from the tables' own knots.

use bess_tables::{Direction, Lut, Resistance};

use crate::model::{StringModel, StringState};

/// A closed interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Range {
    /// The interval of one value.
    pub fn point(value: f64) -> Self {
        Self { low: value, high: value }
    }

    /// The smallest interval that contains both.
    pub fn union(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Intersection; the lower end is above the upper one if it is empty.
    pub fn intersection(&self, other: &Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.min(other.high) }
    }

    /// Negative if it is empty.
    pub(crate) fn width(&self) -> f64 {
        self.high - self.low
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.low > self.high
    }

    /// Whether every number of the other is in this one.
    pub(crate) fn contains(&self, other: &Self) -> bool {
        self.low <= other.low && other.high <= self.high
    }

    /// The knots strictly inside.
    pub(crate) fn inside<'k>(&self, knots: &'k [f64]) -> impl Iterator<Item = f64> + 'k {
        let Self { low, high } = *self;
        knots.iter().copied().filter(move |&knot| knot > low && knot < high)
    }

    /// The knots strictly inside, then both ends.
    pub(crate) fn places<'k>(&self, knots: &'k [f64]) -> impl Iterator<Item = f64> + 'k {
        self.inside(knots).chain([self.low, self.high])
    }

    pub(crate) const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    #[inline]
    pub(crate) fn include(&mut self, value: f64) {
        self.low = self.low.min(value);
        self.high = self.high.max(value);
    }
}

impl FromIterator<f64> for Range {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut range = Self::EMPTY;
        values.into_iter().for_each(|value| range.include(value));
        range
    }
}

/// States that one string may be in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateBox {
    /// State of charge.
    pub soc: Range,
    /// Mean temperature [degC].
    pub temperature_c: Range,
}

impl StateBox {
    /// Intersection.
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            soc: self.soc.intersection(&other.soc),
            temperature_c: self.temperature_c.intersection(&other.temperature_c),
        }
    }

    /// The smallest box that contains both.
    pub(crate) fn union(&self, other: &Self) -> Self {
        Self {
            soc: self.soc.union(&other.soc),
            temperature_c: self.temperature_c.union(&other.temperature_c),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.soc.is_empty() || self.temperature_c.is_empty()
    }

    /// Whether every state of the other is in this one.
    pub(crate) fn contains(&self, other: &Self) -> bool {
        self.soc.contains(&other.soc) && self.temperature_c.contains(&other.temperature_c)
    }
}

impl From<StringState> for StateBox {
    fn from(state: StringState) -> Self {
        Self { soc: Range::point(state.soc), temperature_c: Range::point(state.temperature_c) }
    }
}

/// Coefficients over a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoefficientRanges {
    /// Derating factor.
    pub derating: Range,
    /// Open-circuit voltage [V].
    pub voltage_v: Range,
    /// Resistance [Ohm].
    pub resistance_ohm: Range,
    /// `V^2 / R` [W]: heat is a function of internal power and this number only, and decreases with it.
    pub power_scale_w: Range,
}

/// Part of a box in which one formula holds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    pub soc: [f64; 2],
    pub temperature_c: [f64; 2],
    pub below_switch: bool,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    pub soc: f64,
    pub temperature_c: f64,
    pub voltage_v: f64,
    pub resistance_ohm: f64,
}

impl StringModel {
    /// Ranges of `k`, `V`, `R` and `V^2 / R` over a box.
    ///
    /// The box is cut at every knot (and at the low-SOC switch, where the resistance jumps). Within a piece `V`
    /// and `R` are bilinear, so their extremes lie at its corners and are exact. `V^2 / R` is bounded by the
    /// extremes of a piece, which is exact where `V` rises and `R` does not rise with SOC, and `V` does not
    /// depend on temperature.
    pub fn ranges(&self, direction: Direction, states: &StateBox) -> CoefficientRanges {
        let mut out = CoefficientRanges {
            derating: lut_range(&self.parameters.derating.factor, &states.temperature_c),
            voltage_v: Range::EMPTY,
            resistance_ohm: Range::EMPTY,
            power_scale_w: Range::EMPTY,
        };
        for piece in self.pieces(direction, states) {
            let corners = self.corners(direction, &piece);
            let v: Range = corners.iter().map(|corner| corner.voltage_v).collect();
            let r: Range = corners.iter().map(|corner| corner.resistance_ohm).collect();
            out.voltage_v = out.voltage_v.union(&v);
            out.resistance_ohm = out.resistance_ohm.union(&r);
            out.power_scale_w.include(v.low * v.low / r.high);
            out.power_scale_w.include(v.high * v.high / r.low);
        }
        out
    }

    /// Parts of a box in each of which `V` and `R` are bilinear.
    pub(crate) fn pieces(&self, direction: Direction, states: &StateBox) -> Vec<Piece> {
        let p = &self.parameters;
        let ocv = p.ocv_table(direction);
        let mut socs = vec![states.soc.low, states.soc.high];
        let mut temperatures = vec![states.temperature_c.low, states.temperature_c.high];
        socs.extend(states.soc.inside(ocv.x()));
        temperatures.extend(states.temperature_c.inside(ocv.y()));
        let mut switch = f64::NEG_INFINITY;
        match &p.resistance {
            Resistance::Switched { temperature, soc_factor, low_soc_switch } => {
                socs.extend(states.soc.inside(soc_factor.x()));
                socs.extend(states.soc.inside(&[*low_soc_switch]));
                temperatures.extend(states.temperature_c.inside(temperature.x()));
                switch = *low_soc_switch;
            }
            Resistance::Measured { charge, discharge, .. } => {
                for grid in direction.pick(charge, discharge) {
                    socs.extend(states.soc.inside(grid.x()));
                    temperatures.extend(states.temperature_c.inside(grid.y()));
                }
            }
        }
        socs.sort_unstable_by(f64::total_cmp);
        temperatures.sort_unstable_by(f64::total_cmp);

        let mut pieces = Vec::with_capacity(socs.len() * temperatures.len());
        for temperature_c in temperatures.windows(2) {
            let temperature_c = [temperature_c[0], temperature_c[1]];
            for soc in socs.windows(2) {
                // One formula of R holds in the whole piece; a piece below the switch includes the limit there.
                let below_switch = if soc[0] == soc[1] { soc[0] < switch } else { soc[1] <= switch };
                pieces.push(Piece { soc: [soc[0], soc[1]], temperature_c, below_switch });
            }
            // A box that ends on the switch from below may also be on it.
            if states.soc.high == switch {
                pieces.push(Piece { soc: [switch, switch], temperature_c, below_switch: false });
            }
        }
        pieces
    }

    /// Coefficients at the four corners of a piece, with the formula of that piece.
    pub(crate) fn corners(&self, direction: Direction, piece: &Piece) -> [Corner; 4] {
        let [s0, s1] = piece.soc;
        let [t0, t1] = piece.temperature_c;
        [(s0, t0), (s0, t1), (s1, t0), (s1, t1)].map(|(soc, temperature_c)| Corner {
            soc,
            temperature_c,
            voltage_v: self.parameters.ocv(direction, soc, temperature_c),
            resistance_ohm: self.resistance_on_side(direction, soc, temperature_c, piece.below_switch),
        })
    }

    fn resistance_on_side(&self, direction: Direction, soc: f64, temperature_c: f64, below: bool) -> f64 {
        match &self.parameters.resistance {
            Resistance::Switched { temperature, soc_factor, .. } => {
                let at_temperature = temperature.at(temperature_c);
                if below {
                    soc_factor.at(soc) * at_temperature
                } else {
                    at_temperature
                }
            }
            measured @ Resistance::Measured { .. } => measured.control_at(direction, soc, temperature_c),
        }
    }
}

/// Range of a piecewise linear table over an interval of its argument; knots have the values of the table, without rounding.
fn lut_range(lut: &Lut, x: &Range) -> Range {
    let inside = lut.x().iter().zip(lut.y()).filter(|(knot, _)| **knot > x.low && **knot < x.high);
    inside.map(|(_, value)| *value).chain([lut.at(x.low), lut.at(x.high)]).collect()
}
