//! Reactive power: allocation at minimum loss (`share`), and the cost of active power at a power factor (below);
//! docs/equations.md, R1 to R4.

mod share;

use bess_tables::Lut;

use crate::model::LossCurve;

/// Width of the loss step at the start of another inverter, as a share of the nominal power.
const STEP: f64 = 1e-6;

/// Loss over active power, up to `max_w`, of an inverter that carries `factor` times as much apparent power (R4).
/// Apparent power above its nominal power is carried by identical inverters, which are on for this purpose only.
pub(crate) fn curve_at_power_factor(curve: &LossCurve, nominal_w: f64, factor: f64, max_w: f64) -> LossCurve {
    if factor == 1.0 {
        return curve.clone();
    }
    let full_w = curve.at(nominal_w).0;
    let (mut x, mut y) = (vec![], vec![]);
    let mut others = 0.0;
    while x.is_empty() || others * nominal_w < factor * max_w {
        for (&knot, &loss) in curve.power().iter().zip(curve.loss()) {
            let knot = if others > 0.0 { knot.max(STEP * nominal_w) } else { knot };
            let power_w = (others * nominal_w + knot) / factor;
            // Knots within the step to another inverter are left out.
            if x.last().is_none_or(|&last| power_w > last) {
                x.push(power_w);
                y.push(others * full_w + loss);
            }
        }
        others += 1.0;
    }
    let table = Lut::new("loss at a power factor", x, y).expect("knots ascend");
    LossCurve::new(&table, curve.direction(), nominal_w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bess_tables::Direction;

    #[test]
    fn the_loss_is_that_of_the_apparent_power_and_of_more_inverters_above_the_nominal_one() {
        let table = Lut::new("w", vec![0.0, 5e-5, 50.0, 100.0], vec![2.0, 2.0, 3.0, 7.0]).unwrap();
        for direction in [Direction::Charge, Direction::Discharge] {
            let curve = LossCurve::new(&table, direction, 100.0);
            let scaled = curve_at_power_factor(&curve, 100.0, 2.5, 90.0);
            for power in [0.0, 7.0, 20.0, 31.0, 40.0] {
                assert!((scaled.at(power).0 - table.at(2.5 * power)).abs() < 1e-9, "{power}");
            }
            for (power, others) in [(41.0, 1.0), (62.0, 1.0), (80.0, 1.0), (81.0, 2.0), (90.0, 2.0)] {
                let expected = others * 7.0 + table.at(2.5 * power - 100.0 * others);
                assert!((scaled.at(power).0 - expected).abs() < 1e-3, "{power}");
            }
        }
    }
}
