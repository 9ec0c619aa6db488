//! Coefficients of the convex relaxation (docs/equations.md, 11 to 22) over a node, per unit: powers relative to the nominal power
//! of the string, losses to the losses at nominal power, temperatures as `(tau - 25 degC) / 10 K`, stored energy to the energy of
//! one step at nominal power.

use bess_tables::{Direction, Resistance};

use super::node::{Node, SOC_MARGIN};
use crate::model::{CoefficientRanges, ControlHorizon, LossCurve, Range, StateBox, StringModel, StringState};

const THETA_ZERO_C: f64 = 25.0;
const THETA_UNIT_K: f64 = 10.0;
/// Lines below the inverter loss.
const N_LINES: usize = 6;
/// Outward shift of lines and bounds, per unit: no two opposite rows coincide.
const MARGIN: f64 = 1e-8;

/// Names of their slopes and intercepts.
const LINES: [(&str, &str); N_LINES] = [
    ("inverter_slope_0", "inverter_0_0"),
    ("inverter_slope_1", "inverter_0_1"),
    ("inverter_slope_2", "inverter_0_2"),
    ("inverter_slope_3", "inverter_0_3"),
    ("inverter_slope_4", "inverter_0_4"),
    ("inverter_slope_5", "inverter_0_5"),
];

/// Nominal losses of a string: units of the inverter and the battery loss [W].
#[derive(Debug, Clone, Copy)]
pub struct LossUnits {
    /// [W]
    pub inverter_w: f64,
    /// [W]
    pub battery_w: f64,
}

/// Integral of an open-circuit voltage over SOC: stored energy per capacity [V].
struct Potential {
    soc: Vec<f64>,
    voltage_v: Vec<f64>,
    integral: Vec<f64>,
}

impl Potential {
    fn new(string: &StringModel, direction: Direction, temperature_c: f64) -> Self {
        let soc: Vec<f64> = string.parameters.ocv_table(direction).x().to_vec();
        let voltage_v: Vec<f64> =
            soc.iter().map(|&s| string.parameters.ocv(direction, s, temperature_c)).collect();
        let mut integral = vec![0.0];
        for i in 1..soc.len() {
            let part = 0.5 * (voltage_v[i] + voltage_v[i - 1]) * (soc[i] - soc[i - 1]);
            integral.push(integral[i - 1] + part);
        }
        Self { soc, voltage_v, integral }
    }

    /// Segment of an SOC, and position in it.
    fn segment(&self, soc: f64) -> (usize, f64) {
        let i = self.soc.partition_point(|s| *s <= soc).clamp(1, self.soc.len() - 1) - 1;
        (i, soc - self.soc[i])
    }

    fn slope(&self, i: usize) -> f64 {
        (self.voltage_v[i + 1] - self.voltage_v[i]) / (self.soc[i + 1] - self.soc[i])
    }

    fn at(&self, soc: f64) -> f64 {
        let (i, beyond) = self.segment(soc);
        self.integral[i] + beyond * (self.voltage_v[i] + 0.5 * self.slope(i) * beyond)
    }

    fn voltage(&self, soc: f64) -> f64 {
        let (i, beyond) = self.segment(soc);
        self.voltage_v[i] + self.slope(i) * beyond
    }

    /// Segments that a range touches.
    fn segments(&self, soc: &Range) -> std::ops::RangeInclusive<usize> {
        self.segment(soc.low).0..=self.segment(soc.high).0
    }

    /// Range of the voltage.
    fn voltages(&self, soc: &Range) -> Range {
        let knots = self.soc.iter().zip(&self.voltage_v).filter(|(s, _)| **s > soc.low && **s < soc.high);
        knots.map(|(_, v)| *v).chain([self.voltage(soc.low), self.voltage(soc.high)]).collect()
    }

    /// Range of the slope of the voltage.
    fn slopes(&self, soc: &Range) -> Range {
        self.segments(soc).map(|i| self.slope(i)).collect()
    }

    /// Range of the integral less a line with this slope.
    fn beyond_line(&self, soc: &Range, slope: f64) -> Range {
        let value = |s: f64| self.at(s) - slope * s;
        let within = |s: &f64| *s > soc.low && *s < soc.high;
        let stationary = self.segments(soc).filter_map(|i| {
            let rise = self.slope(i);
            (rise != 0.0).then(|| self.soc[i] + (slope - self.voltage_v[i]) / rise)
        });
        soc.places(&self.soc).chain(stationary.filter(within)).map(value).collect()
    }
}

impl ControlHorizon {
    /// Coefficients over a tightened node by name, each `(M, T)`; planes are closest at the states `near` `(M, T)`. Those
    /// of the battery and the derating are taken at these states themselves if `frozen`.
    pub fn relaxed(
        &self,
        of: &Node,
        near: &[StringState],
        frozen: bool,
        units: &[LossUnits],
    ) -> Vec<(&'static str, Vec<f64>)> {
        let n_steps = self.n_steps();
        let mut out: Vec<(_, Vec<f64>)> = vec![];
        for (m, units) in units.iter().enumerate().take(self.n_strings()) {
            // Voltage in the direction of the first step with a demand; the other direction differs by the hysteresis.
            let first = (0..n_steps).find(|&t| self.demand_w[t] > 0.0).unwrap_or(0);
            let potential =
                Potential::new(self.string(m), self.direction(first), self.start[m].temperature_c);
            for t in 0..n_steps {
                let i = m * n_steps + t;
                let values = self.relaxed_cell(of, &potential, (m, t), near[i], frozen, *units);
                if out.is_empty() {
                    out.extend(values.iter().map(|(name, _)| (*name, vec![])));
                }
                out.iter_mut().zip(values).for_each(|((_, row), (_, value))| row.push(value));
            }
        }
        out
    }

    fn relaxed_cell(
        &self,
        of: &Node,
        potential: &Potential,
        (m, t): (usize, usize),
        near: StringState,
        frozen: bool,
        units: LossUnits,
    ) -> Vec<(&'static str, f64)> {
        let n_steps = self.n_steps();
        let (i, b) = (m * n_steps + t, m * (n_steps + 1) + t);
        let (string, interval, cell) = (self.string(m), &self.intervals[t], &of.cells[i]);
        let direction = interval.direction;
        let discharges = direction == Direction::Discharge;
        let sign = direction.sign();
        let unit_w = string.nominal_w();
        let (states, end) = (&of.boxes[b], &of.boxes[b + 1]);
        let taken_from = if frozen { StateBox::from(near) } else { *states };
        let c = string.ranges(direction, &taken_from);
        let planes = string.planes(direction, &taken_from, near);
        let u = of.requests_w[i];
        let (u_lo, u_hi) = ((u.low / unit_w).max(0.0), (u.high / unit_w).max(0.0));
        let may_run = cell.may_run();
        // Frozen coefficients do not depend on the states, so the ranges of the boxes do not apply.
        let p = match (may_run, frozen) {
            (false, _) => Range::point(0.0),
            (true, false) => cell.delivered_w,
            (true, true) => Range { low: 0.0, high: u.high },
        };
        let battery_w = if !may_run {
            Range::point(0.0)
        } else if frozen {
            string.battery_range(&c, direction, &p)
        } else {
            cell.battery_w
        };
        let must_run = !frozen && may_run && !cell.may_be_off;
        let shed_w = if frozen { cell.shed_w.high.min(u.high) } else { of.max_shed_w[i] };
        let may_shed = cell.may_shed() && shed_w > 0.0;

        // Derating: 1 - k >= derated + derated_per_k tau.
        let (g_lo, g_hi) = (1.0 - c.derating.high, 1.0 - c.derating.low);
        let (g_theta, g_0) =
            (planes.derated_per_k * THETA_UNIT_K, planes.derated + planes.derated_per_k * THETA_ZERO_C);

        let (inverter, chord) = inverter_lines(string.loss(direction), &p, unit_w, units.inverter_w);

        let full = if discharges {
            let edge = cell.shed_soc.high.min(end.soc.high) + SOC_MARGIN;
            (edge, (end.soc.high - edge).max(0.0))
        } else {
            let edge = -cell.shed_soc.low.max(end.soc.low) + SOC_MARGIN;
            (edge, (-end.soc.low - edge).max(0.0))
        };
        let full = if may_shed { full } else { (0.0, 2.0) };

        // y = V^2 / R, in units that make h y = P^2.
        let y_unit = units.battery_w / (unit_w * unit_w);
        let y = Range { low: c.power_scale_w.low * y_unit, high: c.power_scale_w.high * y_unit };
        let [p_low, p_high] = [battery_w.low / unit_w, battery_w.high / unit_w];
        let heat = ((p_low + p_high) / y.low, -p_low * p_high / y.low + MARGIN);

        // Switch of the resistance.
        let switch = match &string.parameters.resistance {
            Resistance::Switched { low_soc_switch, .. } => *low_soc_switch,
            Resistance::Measured { .. } => f64::NEG_INFINITY,
        };
        let soc = taken_from.soc;
        let (may_be_low, must_be_low) = (soc.low < switch, soc.high < switch);
        let (y_above, y_below, switch) = if may_be_low && !must_be_low && !frozen {
            let part = |low: f64, high: f64| {
                let part = StateBox { soc: Range { low, high }, ..taken_from };
                string.ranges(direction, &part).power_scale_w.high * y_unit
            };
            (part(switch, soc.high), part(soc.low, just_below(switch)), switch)
        } else {
            (y.high, y.high, if must_be_low { states.soc.high } else { states.soc.low })
        };

        // Charge per unit of V I, and energy per unit of charge beyond the change of the potential.
        let per_unit = unit_w * interval.dt_h / string.parameters.capacity_ah;
        let current = Range { low: per_unit / c.voltage_v.high, high: per_unit / c.voltage_v.low };
        let reverse = (-p_low).max(0.0);
        let moved = if frozen {
            Range { low: -reverse * current.high, high: f64::INFINITY }
        } else {
            let per_ampere = interval.dt_h / string.parameters.capacity_ah;
            Range { low: per_ampere * cell.current_a.low, high: per_ampere * cell.current_a.high }
        };
        let beyond = string.beyond_potential(potential, direction, (states, end), &c, frozen, &moved);
        let beyond = Range { low: beyond.low / per_unit, high: beyond.high / per_unit };

        // The stored energy between lines over the box at the end.
        let start = potential.at(self.start[m].soc);
        let line = |slope: f64| {
            let range = potential.beyond_line(&end.soc, slope);
            (
                slope / per_unit,
                (range.low - start) / per_unit - MARGIN,
                (range.high - start) / per_unit + MARGIN,
            )
        };
        let width = end.soc.high - end.soc.low;
        let secant = if width > 1e-9 {
            (potential.at(end.soc.high) - potential.at(end.soc.low)) / width
        } else {
            potential.voltage(end.soc.low)
        };
        let lines = [secant, potential.voltage(end.soc.low), potential.voltage(end.soc.high)].map(line);

        let flag = |is: bool| f64::from(u8::from(is));
        let mut out = vec![
            ("u_lo", u_lo),
            ("u_hi", u_hi),
            ("p_lo", p.low / unit_w),
            ("p_hi", p.high / unit_w),
            ("a_hi", shed_w.max(0.0) / unit_w),
            ("a_off", if c.derating.low < 1.0 { (string.min_power_w() / unit_w).min(u_hi) } else { 0.0 }),
            ("derating_lo", g_lo),
            ("derating_hi", g_hi),
            ("derating_theta", u_hi * g_theta),
            ("derating_0", u_hi * (g_0 - g_hi)),
            ("derated_theta", u_lo * g_theta),
            ("derated_0", u_lo * (g_0 - g_lo)),
            ("full_0", full.0 + full.1),
            ("full_slack", full.1),
            ("inverter_chord_slope", chord.0),
            ("inverter_chord_0", chord.1),
            ("heat_chord", heat.0),
            ("heat_0", heat.1),
            ("y_lo", y.low),
            ("y_hi", y.high),
            ("y_soc", planes.power_scale_per_soc * y_unit),
            ("y_theta", planes.power_scale_per_k * THETA_UNIT_K * y_unit),
            ("y_0", (planes.power_scale_w + planes.power_scale_per_k * THETA_ZERO_C) * y_unit - y.low),
            ("y_above", y_above),
            ("y_below", y_below - y_above),
            // soc >= switch - (switch - lo) low, soc <= hi - (hi - switch) low.
            ("switch_lo", switch),
            ("switch_0", (switch - states.soc.low).max(0.0)),
            ("switch_hi", states.soc.high),
            ("switch_1", (states.soc.high - switch).max(0.0)),
            ("current_lo", current.low),
            ("current_hi", current.high),
            ("current_0", (current.high - current.low) * reverse + MARGIN),
            ("potential_lo", sign * beyond.low),
            ("potential_hi", sign * beyond.high),
            ("potential_0", (beyond.high - beyond.low) * (-moved.low).max(0.0) + MARGIN),
            ("soc_lo", end.soc.low),
            ("soc_hi", end.soc.high),
            ("stored_hi_soc", lines[0].0),
            ("stored_hi_0", lines[0].2),
            ("stored_lo_soc_0", lines[1].0),
            ("stored_lo_0_0", lines[1].1),
            ("stored_lo_soc_1", lines[2].0),
            ("stored_lo_0_1", lines[2].1),
            ("may_run", flag(may_run)),
            ("must_run", flag(must_run)),
            ("may_shed", flag(may_shed)),
            ("may_be_low", flag(may_be_low)),
            ("must_be_low", flag(must_be_low)),
        ];
        for ((slope_name, name), (slope, intercept)) in LINES.into_iter().zip(inverter) {
            out.extend([(slope_name, slope), (name, intercept)]);
        }
        out
    }
}

impl StringModel {
    /// Range of the difference between `V I` and the change of the potential, per unit of charge [V].
    fn beyond_potential(
        &self,
        potential: &Potential,
        direction: Direction,
        (states, end): (&StateBox, &StateBox),
        c: &CoefficientRanges,
        frozen: bool,
        moved: &Range,
    ) -> Range {
        let path = states.soc.union(&end.soc);
        if frozen {
            let v = potential.voltages(&path);
            return Range { low: c.voltage_v.low - v.high, high: c.voltage_v.high - v.low };
        }
        // The voltage of the step minus that of the potential, at equal SOC.
        let table = self.parameters.ocv_table(direction);
        let at = |soc: f64| states.temperature_c.places(table.y()).map(move |at_c| (soc, at_c));
        let places = states.soc.places(table.x()).flat_map(at);
        let apart: Range = places
            .map(|(soc, at_c)| self.parameters.ocv(direction, soc, at_c) - potential.voltage(soc))
            .collect();
        // Half the change of the voltage by the charge of the step, towards its mean; of the other sign where the voltage falls.
        let slopes = potential.slopes(&path);
        let sign = direction.sign();
        let ends = [
            slopes.low * moved.low,
            slopes.low * moved.high,
            slopes.high * moved.low,
            slopes.high * moved.high,
        ];
        let half: Range = ends.iter().map(|e| 0.5 * sign * e).collect();
        Range { low: apart.low + half.low, high: apart.high + half.high }
    }

    /// Range of `V I` over delivered powers, at the smallest and the largest `V^2 / R` [W].
    fn battery_range(&self, c: &CoefficientRanges, direction: Direction, p: &Range) -> Range {
        let Range { low: g_low, high: g_high } = self.loss(direction).internal_range(p.low, p.high);
        let heat = |g: f64, y: f64| crate::model::heat_w(g, y, direction);
        let (low, high) = (c.power_scale_w.low, c.power_scale_w.high);
        match direction {
            Direction::Charge => Range { low: g_low - heat(g_low, low), high: g_high - heat(g_high, high) },
            Direction::Discharge => {
                let g_high = g_high.min(0.25 * high);
                Range { low: g_low + heat(g_low, high), high: g_high + heat(g_high, low.max(4.0 * g_high)) }
            }
        }
    }
}

/// The largest number below a positive one.
fn just_below(value: f64) -> f64 {
    f64::from_bits(value.to_bits() - 1)
}

/// Slopes and intercepts of lines below the inverter loss over a range of delivered power, and of a chord above it.
fn inverter_lines(
    curve: &LossCurve,
    p: &Range,
    unit_w: f64,
    loss_unit_w: f64,
) -> ([(f64, f64); N_LINES], (f64, f64)) {
    let places = [p.low].into_iter().chain(p.inside(curve.power())).chain([p.high]);
    let knots: Vec<_> = places.map(|x| (x / unit_w, curve.at(x).0 / loss_unit_w)).collect();
    let rise = |a: (f64, f64), b: (f64, f64)| if b.0 > a.0 { (b.1 - a.1) / (b.0 - a.0) } else { 0.0 };
    let mut hull: Vec<(f64, f64)> = vec![];
    for &knot in &knots {
        while let [.., a, b] = hull[..] {
            if rise(a, b) < rise(b, knot) && b.0 > a.0 {
                break;
            }
            hull.pop();
        }
        hull.push(knot);
    }
    let n = hull.len() - 1;
    let line = |j: usize| {
        let k = (j * (n - 1)).div_ceil(N_LINES - 1).min(n - 1);
        let slope = rise(hull[k], hull[k + 1]);
        (slope, hull[k].1 - slope * hull[k].0)
    };
    let chord = rise(knots[0], knots[knots.len() - 1]);
    let above = knots.iter().map(|(x, w)| w - chord * x).fold(f64::NEG_INFINITY, f64::max);
    (std::array::from_fn(line), (chord, above + MARGIN))
}
