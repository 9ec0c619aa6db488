//! Lower bounds of a horizon, and the states that a schedule can reach which costs no more than a known one.
//!
//! One-step problems bound a horizon once their coefficients are at the best end of what each string can reach. Two
//! things make that tight. The first is a value of the state: a step pays for a high `V^2 / R`, and earlier steps are
//! paid for the charge and the warmth that make it high, so that what one step gains another has to earn. The second is
//! the cutoff: a schedule that costs no more than a known one exceeds the bound by no more than the slack between the
//! two, so a string's charge cannot stray far from where it should be; that is a knapsack, bounded by rewarding the
//! string for straying. Narrower boxes give a higher bound, and so on.

use bess_tables::Direction;

use crate::bounds::{step_bound, StepBound};
use crate::error::{check_length, check_range};
use crate::horizon::{ControlHorizon, LossCosts};
use crate::lagrangian::{maximise, Choice};
use crate::model::{StringState, SECONDS_PER_HOUR};
use crate::one_step_curve::{CostCurve, Terms};
use crate::planes::Planes;
use crate::ranges::{CoefficientRanges, Range, StateBox};
use crate::ControlError;

/// Most rounds of bounding and narrowing.
const ROUNDS: usize = 8;
/// A round that leaves more than this share of the slack is the last.
const WORTHWHILE: f64 = 0.9;
/// A slack below this share of the cost is small enough.
const CLOSED: f64 = 2e-4;
/// Safety for rounding, relative to the cost, and of the states.
const ROUNDING: f64 = 1e-9;
const SOC_ROUNDING: f64 = 1e-9;
const TEMPERATURE_ROUNDING_K: f64 = 1e-6;
/// Rewards of the power of a string, in mean prices of the demand.
const POWER_REWARDS: [f64; 4] = [0.03, 0.1, 0.3, 1.0];
/// Rewards of its warmth, in costs of the heat.
const HEAT_REWARDS: [f64; 4] = [0.1, 0.25, 0.5, 0.8];
const N_REWARDS: usize = POWER_REWARDS.len();

/// What is known of every schedule that costs no more than a given one.
#[derive(Debug, Clone)]
pub struct Confined {
    /// None costs less than this.
    pub bound: f64,
    /// Its states, at the start of each step and at the end of the last, `(M, T + 1)`.
    pub boxes: Vec<StateBox>,
}

/// A schedule: its cost, the states at the start of its steps `(M, T)`, and how fast its cost falls with the `V^2 / R`
/// there, `-dh/dy = s^2 / (1 +- 2 s)` with `s = R I / V`.
#[derive(Debug, Clone)]
struct Known {
    cost: f64,
    states: Vec<StringState>,
    scale_price: Vec<f64>,
}

/// What the state of a string is worth at a step.
#[derive(Debug, Clone, Copy, Default)]
struct Values {
    /// Price of `V^2 / R` in the step itself [1/W].
    scale_price: f64,
    /// Value of a unit of SOC gained in the step.
    charge: f64,
    /// Value of a kelvin of warming by the heat of the step.
    warmth: f64,
}

/// What of a string is to be bounded from above.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Target {
    /// SOC gained, times the sign.
    Charge(f64),
    /// Warming by its own heat, times the sign.
    Warmth(f64),
}

/// The Lagrangian of a step at a price of the demand: its value, and what each string has in it.
struct AtPrice {
    price: f64,
    bound: f64,
    parts: Vec<f64>,
}

/// One step over boxes, with the values of the state.
struct Step {
    values: Vec<Values>,
    curves: Vec<CostCurve>,
    constants: Vec<f64>,
    bound: StepBound,
    price: f64,
}

/// Boxes, and what the strings can do in them, `(M, T)`.
struct Reach<'a> {
    horizon: &'a ControlHorizon,
    boxes: &'a [StateBox],
    ranges: Vec<CoefficientRanges>,
    planes: Vec<Planes>,
    current_a: Vec<Range>,
    heat_w: Vec<Range>,
    may_shed: Vec<bool>,
}

/// Bounds of all steps over boxes.
struct Round<'a> {
    reach: &'a Reach<'a>,
    costs: &'a [LossCosts],
    /// None where there is no demand.
    steps: Vec<Option<Step>>,
    /// Lower bound of the cost of any schedule, if nothing is shed.
    bound: f64,
}

/// Lagrangians of a step around its best price.
struct Around {
    best: AtPrice,
    below: Vec<AtPrice>,
    above: Vec<AtPrice>,
}

/// A bounded round, and what schedules within a slack of its bound can do.
struct Cutoff<'a> {
    round: &'a Round<'a>,
    slack: f64,
    mean_price: f64,
    around: Vec<Option<Around>>,
}

impl ControlHorizon {
    /// Bounds the cost of every schedule, and the states of those that cost no more than `request_w` `(M, T)`, which
    /// sheds at most `shed_budget_w` in all. `costs` `(M,)` [1/W] are those of the losses.
    pub fn confine(
        &self,
        request_w: &[f64],
        costs: &[LossCosts],
        shed_budget_w: f64,
    ) -> Result<Confined, ControlError> {
        check_length("costs", costs.as_flattened(), 4 * self.n_strings())?;
        check_range("costs", costs.as_flattened(), (0.0, f64::MAX), " 1/W")?;
        check_range("shed_budget", &[shed_budget_w], (0.0, f64::INFINITY), " W")?;
        let mut best = Confined { bound: 0.0, boxes: self.reachable() };
        if costs.iter().all(|c| c[1..].iter().all(|&c| c == 0.0)) {
            // Only what is shed costs: no state is worth more than another.
            return Ok(best);
        }
        let known = self.known(request_w, costs);
        let cutoff = known.cost;
        let cheapest_shed = costs.iter().map(|c| c[0]).fold(f64::INFINITY, f64::min);
        let (mut last, mut priced) = (f64::INFINITY, false);
        let valueless = Known { scale_price: vec![0.0; request_w.len()], ..known.clone() };
        for _ in 0..ROUNDS {
            let boxes = std::mem::take(&mut best.boxes);
            let reach = Reach::new(self, &boxes, &known.states);
            let bounded = |known: &Known| {
                let round = Round::new(&reach, costs, &known.scale_price, shed_budget_w);
                (round.bound - round.saved(shed_budget_w, cheapest_shed), round)
            };
            // Over wide boxes the planes may lie so high that the values of the state do more harm than good.
            let mut held = bounded(&known);
            if !priced {
                let without = bounded(&valueless);
                priced = held.0 >= without.0;
                if !priced {
                    held = without;
                }
            }
            let (bound, round) = held;
            best.bound = best.bound.max(bound - ROUNDING * cutoff).min(cutoff);
            let slack = cutoff - bound + ROUNDING * cutoff;
            if slack <= CLOSED * cutoff || slack > WORTHWHILE * last {
                best.boxes = boxes;
                break;
            }
            last = slack;
            match Cutoff::new(&round, slack).narrowed() {
                Some(boxes) => best.boxes = boxes,
                None => {
                    best = Confined { bound: cutoff, boxes };
                    break;
                }
            }
        }
        Ok(best)
    }

    /// A schedule rolled out.
    fn known(&self, request_w: &[f64], costs: &[LossCosts]) -> Known {
        let mut known = Known { cost: 0.0, states: vec![], scale_price: vec![] };
        for (m, requests) in request_w.chunks_exact(self.n_steps()).enumerate() {
            let mut state = self.start[m];
            for (t, &request) in requests.iter().enumerate() {
                let c = self.string(m).coefficients(self.direction(t), state);
                let flow = self.string(m).step(state, request, &self.intervals[t]);
                let losses = [flow.availability_w, flow.derating_w, flow.inverter_w, flow.battery_w];
                known.cost += costs[m].iter().zip(losses).map(|(c, loss)| c * loss).sum::<f64>();
                let share = (flow.current_a * c.resistance_ohm / c.voltage_v).max(0.0);
                let sign = if self.direction(t) == Direction::Charge { 1.0 } else { -1.0 };
                let price = costs[m][3] * share * share / (1.0 + 2.0 * sign * share).max(0.1);
                known.scale_price.push(price);
                known.states.push(state);
                state = flow.end;
            }
        }
        known
    }
}

impl<'a> Reach<'a> {
    fn new(horizon: &'a ControlHorizon, boxes: &'a [StateBox], near: &[StringState]) -> Self {
        let n_steps = horizon.n_steps();
        let mut may_shed = vec![false; n_steps];
        let (mut ranges, mut planes, mut current_a, mut heat_w) = (vec![], vec![], vec![], vec![]);
        for m in 0..horizon.n_strings() {
            let string = horizon.string(m);
            for t in 0..n_steps {
                let states = &boxes[m * (n_steps + 1) + t];
                let (interval, requests) = (&horizon.intervals[t], horizon.request_range(m, t));
                ranges.push(string.ranges(interval.direction, states));
                planes.push(string.planes(interval.direction, states, near[m * n_steps + t]));
                let (current, heat) =
                    string.current_and_heat(states, &requests, interval.direction, interval.dt_h);
                may_shed[t] |= string.may_shed(states, &requests, &current, interval);
                current_a.push(current);
                heat_w.push(heat);
            }
        }
        Self { horizon, boxes, ranges, planes, current_a, heat_w, may_shed }
    }

    fn cell(&self, m: usize, t: usize) -> usize {
        m * self.horizon.n_steps() + t
    }

    /// Share of a temperature difference that is left after a step.
    fn keep(&self, m: usize, t: usize) -> f64 {
        let dt_s = self.horizon.intervals[t].dt_h * SECONDS_PER_HOUR;
        1.0 - dt_s * self.horizon.string(m).parameters.lumped.k2_per_s
    }

    /// Kelvin of warming for each watt of heat in a step.
    fn kelvin_per_w(&self, m: usize, t: usize) -> f64 {
        let dt_s = self.horizon.intervals[t].dt_h * SECONDS_PER_HOUR;
        dt_s * self.horizon.string(m).parameters.lumped.k1_k_per_j
    }

    /// What one step can add to the target, whatever it costs.
    fn of_step(&self, m: usize, t: usize, target: Target) -> Range {
        let (horizon, cell) = (self.horizon, self.cell(m, t));
        let (range, factor) = match target {
            Target::Charge(sign) => {
                let per_ampere = horizon.intervals[t].dt_h / horizon.string(m).parameters.capacity_ah;
                let toward = if horizon.direction(t) == Direction::Charge { sign } else { -sign };
                (self.current_a[cell], toward * per_ampere)
            }
            Target::Warmth(sign) => (self.heat_w[cell], sign * self.kelvin_per_w(m, t)),
        };
        let (a, b) = (factor * range.low, factor * range.high);
        Range { low: a.min(b), high: a.max(b) }
    }
}

impl<'a> Round<'a> {
    fn new(reach: &'a Reach<'a>, costs: &'a [LossCosts], scale_price: &[f64], shed_budget_w: f64) -> Self {
        let horizon = reach.horizon;
        let (n_strings, n_steps) = (horizon.n_strings(), horizon.n_steps());
        let mut round = Self { reach, costs, steps: Vec::with_capacity(n_steps), bound: 0.0 };
        let mut values = Vec::with_capacity(n_strings);
        for m in 0..n_strings {
            let (of_string, worth) = round.values(m, &scale_price[m * n_steps..(m + 1) * n_steps]);
            values.push(of_string);
            round.bound -= worth;
        }
        for t in 0..n_steps {
            let demand_w = horizon.demand_w[t];
            if demand_w <= 0.0 {
                round.steps.push(None);
                continue;
            }
            let values: Vec<Values> = (0..n_strings).map(|m| values[m][t]).collect();
            let curve = |m: usize| round.curve(m, t, &values[m], f64::INFINITY);
            let (mut curves, constants): (Vec<_>, Vec<_>) = (0..n_strings).map(curve).unzip();
            let price = maximise(&curves, &Choice::free(n_strings), demand_w, 0.0).price;
            let budget_w = if reach.may_shed[t] { shed_budget_w } else { 0.0 };
            let (mut bound, _) = step_bound(&mut curves, demand_w, budget_w);
            bound.phi += constants.iter().sum::<f64>();
            round.bound += bound.phi;
            round.steps.push(Some(Step { values, curves, constants, bound, price }));
        }
        round
    }

    /// Values of a string's state: what `V^2 / R` later in the horizon gains from charge and warmth now; and what it is
    /// worth along a string that stays idle.
    fn values(&self, m: usize, prices: &[f64]) -> (Vec<Values>, f64) {
        let (reach, n_steps) = (self.reach, prices.len());
        let planes = &reach.planes[m * n_steps..(m + 1) * n_steps];
        let mut out = vec![Values::default(); n_steps];
        let (mut charge, mut warmth) = (0.0, 0.0);
        for t in (0..n_steps).rev() {
            out[t] = Values { scale_price: prices[t], charge, warmth };
            charge += prices[t] * planes[t].power_scale_per_soc;
            warmth = reach.keep(m, t) * warmth + prices[t] * planes[t].power_scale_per_k;
        }
        let start = reach.horizon.start[m];
        let (mut idle_c, mut worth) = (start.temperature_c, 0.0);
        for (t, plane) in planes.iter().enumerate() {
            worth += prices[t]
                * (plane.power_scale_w
                    + plane.power_scale_per_soc * start.soc
                    + plane.power_scale_per_k * idle_c);
            let keep = reach.keep(m, t);
            idle_c = keep * idle_c + (1.0 - keep) * reach.horizon.intervals[t].ambient_c;
        }
        (out, worth)
    }

    /// Cost of a string in a step less the values of what it does, and a constant that goes with it.
    fn curve(&self, m: usize, t: usize, values: &Values, shed_cost: f64) -> (CostCurve, f64) {
        let horizon = self.reach.horizon;
        let string = horizon.string(m);
        let ranges = &self.reach.ranges[self.reach.cell(m, t)];
        let direction = horizon.direction(t);
        let limit_w = horizon.limit(m, t);
        let loss = string.loss(direction);
        let v = ranges.voltage_v;
        // Charge per watt of internal power V I, at the end of the voltage range that bounds from below.
        let per_volt = values.charge * horizon.intervals[t].dt_h / string.parameters.capacity_ah;
        let (gained, ends) = match direction {
            Direction::Charge => (per_volt, [v.low, v.high]),
            Direction::Discharge => (-per_volt, [v.high, v.low]),
        };
        let (usual, other) = if values.charge >= 0.0 { (ends[0], ends[1]) } else { (ends[1], ends[0]) };
        let power_price = -gained / usual;
        let mut costs = self.costs[m];
        let mut constant = 0.0;
        // Internal power is that of the inverter, plus the heat in discharge, less it in charge.
        costs[3] += if direction == Direction::Discharge { power_price } else { -power_price };
        costs[3] -= values.warmth * self.reach.kelvin_per_w(m, t);
        if costs[3] < 0.0 {
            constant += costs[3] * self.reach.heat_w[self.reach.cell(m, t)].high;
            costs[3] = 0.0;
        }
        if direction == Direction::Charge {
            // Where an inverter draws from the battery, the other end of the voltage counts.
            constant -= (gained / usual - gained / other).abs() * loss.at(0.0).0;
        }
        let terms = Terms {
            direction,
            limit_w,
            deliverable_w: string.nominal_w(),
            derating: ranges.derating,
            power_scale_w: ranges.power_scale_w,
            scale_price: values.scale_price,
            power_price,
            costs,
            shed_cost,
        };
        (CostCurve::new(loss, terms), constant)
    }

    /// The most that shedding can save.
    fn saved(&self, budget_w: f64, cheapest_shed: f64) -> f64 {
        let mut slopes: Vec<_> = (self.steps.iter().zip(&self.reach.horizon.demand_w))
            .filter_map(|(step, demand_w)| Some((step.as_ref()?.bound.shed_slope - cheapest_shed, *demand_w)))
            .filter(|(slope, _)| *slope > 0.0 && slope.is_finite())
            .collect();
        slopes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut left_w = budget_w;
        let mut saved = 0.0;
        for (slope, demand_w) in slopes {
            let shed_w = demand_w.min(left_w);
            saved += slope * shed_w;
            left_w -= shed_w;
        }
        saved
    }
}

impl<'a> Cutoff<'a> {
    fn new(round: &'a Round<'a>, slack: f64) -> Self {
        let demand_w = &round.reach.horizon.demand_w;
        let priced = || round.steps.iter().flatten();
        let mean_price = priced().map(|step| step.price.abs()).sum::<f64>() / priced().count().max(1) as f64;
        let around = |(step, demand_w): (&Option<Step>, &f64)| {
            let Step { curves, constants, price, .. } = step.as_ref()?;
            let at = |price: f64| AtPrice::new(curves, constants, *demand_w, price);
            let n_on = curves.iter().filter(|c| c.free(*price).request_w > 0.0).count().max(1) as f64;
            let shifted =
                |sign: f64| POWER_REWARDS.iter().map(|r| at(price + sign * r * mean_price / n_on)).collect();
            Some(Around { best: at(*price), below: shifted(-1.0), above: shifted(1.0) })
        };
        let around = round.steps.iter().zip(demand_w).map(around).collect();
        Self { round, slack, mean_price, around }
    }

    /// Narrower boxes, or None if nothing is left of one.
    fn narrowed(&self) -> Option<Vec<StateBox>> {
        let rows = (0..self.round.reach.horizon.n_strings()).map(|m| self.narrowed_string(m));
        rows.collect::<Option<Vec<_>>>().map(|rows| rows.concat())
    }

    fn narrowed_string(&self, m: usize) -> Option<Vec<StateBox>> {
        let reach = self.round.reach;
        let horizon = reach.horizon;
        let row = &reach.boxes[m * (horizon.n_steps() + 1)..(m + 1) * (horizon.n_steps() + 1)];
        let [gained, lost] = [1.0, -1.0].map(|sign| self.most(m, Target::Charge(sign)));
        let [warmed, cool] = [1.0, -1.0].map(|sign| self.most(m, Target::Warmth(sign)));
        let start = horizon.start[m];
        let (mut unheated_c, mut kept) = (start.temperature_c, 1.0);
        let mut out = vec![row[0]];
        for (t, interval) in horizon.intervals.iter().enumerate() {
            let keep = reach.keep(m, t);
            unheated_c = keep * unheated_c + (1.0 - keep) * interval.ambient_c;
            let reached = horizon.string(m).reach(&out[t], &horizon.request_range(m, t), interval);
            let mut now = row[t + 1].intersection(&reached);
            now.soc.low = now.soc.low.max(start.soc - lost[t + 1] - SOC_ROUNDING);
            now.soc.high = now.soc.high.min(start.soc + gained[t + 1] + SOC_ROUNDING);
            if keep > 0.0 {
                // Heat fades on its way: all of it bounds from above, what is left of the oldest from below.
                let low = unheated_c - kept * cool[t + 1] - TEMPERATURE_ROUNDING_K;
                let high = unheated_c + warmed[t + 1] + TEMPERATURE_ROUNDING_K;
                now.temperature_c = now.temperature_c.intersection(&Range { low, high });
                kept *= keep;
            }
            if now.soc.low > now.soc.high || now.temperature_c.low > now.temperature_c.high {
                return None;
            }
            out.push(now);
        }
        Some(out)
    }

    /// Upper bounds `(T + 1,)` of what the target has added up to at each step boundary.
    fn most(&self, m: usize, target: Target) -> Vec<f64> {
        let n_steps = self.around.len();
        let alone: Vec<Range> = (0..n_steps).map(|t| self.round.reach.of_step(m, t, target)).collect();
        let mut best = vec![0.0; n_steps + 1];
        for t in 0..n_steps {
            best[t + 1] = best[t] + alone[t].high;
        }
        let width: f64 = alone.iter().map(|range| range.high - range.low).sum();
        for k in 0..N_REWARDS {
            let reward = self.reward(m, k, target);
            if self.slack >= reward * width {
                continue;
            }
            let mut sum = self.slack / reward;
            for t in 0..n_steps {
                let with_slack = self.around[t].as_ref().zip(self.round.steps[t].as_ref()).map_or(
                    f64::INFINITY,
                    |(around, step)| {
                        (step.bound.phi - self.rewarded(step, around, m, t, k, reward, target)) / reward
                    },
                );
                sum += with_slack.min(alone[t].high);
                best[t + 1] = best[t + 1].min(sum);
            }
        }
        best
    }

    /// Reward of the target, in costs per unit of it.
    fn reward(&self, m: usize, k: usize, target: Target) -> f64 {
        let horizon = self.round.reach.horizon;
        match target {
            Target::Charge(_) => {
                let p = &horizon.string(m).parameters;
                let v = p.ocv(Direction::Discharge, 0.5, 25.0);
                POWER_REWARDS[k] * self.mean_price * v * p.capacity_ah / horizon.intervals[0].dt_h
            }
            Target::Warmth(_) => {
                HEAT_REWARDS[k] * self.round.costs[m][3] / self.round.reach.kelvin_per_w(m, 0)
            }
        }
    }

    /// Lower bound of a step's cost less the reward of what string `m` adds to the target.
    #[allow(clippy::too_many_arguments)]
    fn rewarded(
        &self,
        step: &Step,
        around: &Around,
        m: usize,
        t: usize,
        k: usize,
        reward: f64,
        target: Target,
    ) -> f64 {
        let mut values = step.values[m];
        let eager = match target {
            Target::Charge(sign) => {
                values.charge += sign * reward;
                (sign > 0.0) == (self.round.reach.horizon.direction(t) == Direction::Charge)
            }
            Target::Warmth(sign) => {
                values.warmth += sign * reward;
                sign > 0.0
            }
        };
        let (curve, constant) = self.round.curve(m, t, &values, step.curves[m].terms.shed_cost);
        let shifted = if eager { &around.below[k] } else { &around.above[k] };
        let bound = |at: &AtPrice| at.bound - at.parts[m] + curve.free(at.price).value + constant;
        bound(&around.best).max(bound(shifted))
    }
}

impl AtPrice {
    fn new(curves: &[CostCurve], constants: &[f64], demand_w: f64, price: f64) -> Self {
        let part = |(curve, constant): (&CostCurve, &f64)| curve.free(price).value + constant;
        let parts: Vec<f64> = curves.iter().zip(constants).map(part).collect();
        Self { price, bound: price * demand_w + parts.iter().sum::<f64>(), parts }
    }
}
