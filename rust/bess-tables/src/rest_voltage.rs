//! Rest voltage of a string, and its integral over SOC, which defines chemical energy.

use crate::{Axis, Grid};

/// Temperature of the voltages that define chemical energy [degC].
const CHEMICAL_ENERGY_C: f64 = 25.0;

/// Mean of the open-circuit voltages of charge and discharge at 25 degC, integrated over SOC.
#[derive(Debug, Clone, PartialEq)]
pub struct RestVoltage {
    soc: Axis,
    voltage_v: Vec<f64>,
    /// Integral from the first knot to each [V].
    integral_v: Vec<f64>,
}

impl RestVoltage {
    /// The mean of two tables over the same SOC, of two knots at least.
    pub(crate) fn new(charge: &Grid, discharge: &Grid) -> Self {
        let soc = charge.x().clone();
        let mean = |&at: &f64| 0.5 * (charge.at(at, CHEMICAL_ENERGY_C) + discharge.at(at, CHEMICAL_ENERGY_C));
        let voltage_v: Vec<f64> = soc.iter().map(mean).collect();
        let mut integral_v = vec![0.0; soc.len()];
        for knot in 1..soc.len() {
            let middle_v = 0.5 * (voltage_v[knot - 1] + voltage_v[knot]);
            integral_v[knot] = integral_v[knot - 1] + (soc[knot] - soc[knot - 1]) * middle_v;
        }
        Self { soc, voltage_v, integral_v }
    }

    /// Integral of the voltage from the first knot to a SOC within the knots [V]. Times the capacity it is the chemical energy.
    pub fn integral_v(&self, soc: f64) -> f64 {
        let (segment, share) = self.soc.locate(soc);
        let (from_v, to_v) = (self.voltage_v[segment], self.voltage_v[segment + 1]);
        let middle_v = from_v + 0.5 * share * (to_v - from_v);
        self.integral_v[segment] + (soc - self.soc[segment]) * middle_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_integral_of_a_linear_mean_is_a_parabola_across_knots() {
        let soc = vec![0.1, 0.3, 0.35, 1.0];
        let table = |gap: f64| {
            let volts = soc.iter().flat_map(|s| [0.0, 3.0 + 2.0 * s + gap]).collect();
            Grid::new("ocv", soc.clone(), vec![5.0, 25.0], volts).unwrap()
        };
        let rest = RestVoltage::new(&table(0.02), &table(-0.02));
        let parabola = |s: f64| 3.0 * s + s * s;
        for at in [0.1, 0.2, 0.3, 0.34, 0.35, 0.9, 1.0] {
            assert!((rest.integral_v(at) - (parabola(at) - parabola(0.1))).abs() < 1e-14, "at {at}");
        }
    }
}
