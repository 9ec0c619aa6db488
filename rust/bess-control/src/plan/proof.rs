//! A bound that is proven: prices of the balance, and for strings that are alike one function of state and step that no schedule
//! passes.
//!
//! At prices `l` of the balance (those of [`super::dual`], at most what a watt-hour that is not delivered costs), a function
//! `W_t(x)` of the state that nowhere exceeds `cost(x, u) - l_t u dt + W_{t+1}(f(x, u))` bounds what one string pays, and
//! `sum l_t D_t dt + sum W_0(start)` what any schedule costs (docs/foresight.md, *Bounds*). Here `W_t` is bilinear between nodes of SOC and
//! temperature, and the inequality holds for every state and request, not for nodes alone:
//!
//! - With such prices it never pays to ask for what is not delivered, so a string chooses its current, and asks for what
//!   that takes.
//! - Currents that lead from node to node of SOC, and triangles between them along lines of one SOC at the end: SOC moves
//!   exactly, kinks of `W` at nodes do no harm, and full and empty lie on edges of triangles.
//! - Over a triangle times a cell of temperature, cost and end temperature differ from what lies linearly between the corners
//!   by products of known sign and size, kinks of tables, and kinks of `W` over temperature. [`Shape`] and [`Image`] hold
//!   bounds of these; the values at the corners are lowered by them.
//!
//! The least value at a node, over all triangles that meet there, is therefore a bound between the nodes too.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::Direction;

use crate::model::{Interval, LossCurve, Range, StateBox, StringModel, StringState};
use crate::plan::problem::PlanProblem;

/// Derating factor below which a string counts as derating no further: what is asked for in vain is then far dearer than what
/// is delivered, and a smaller factor would only make the cells uneven.
const LEAST_FACTOR: f64 = 0.4;
/// Cells of temperature where strings derate, for one elsewhere.
const DERATING_CELLS: f64 = 2.0;
/// Most that values bend below the plain ones, against the mean bend of these. Half as much, or twice, lowers the bound of a day
/// at rated demand by 1 %.
const MOST_BEND: f64 = 10.0;
/// Cells of temperature grow finer with those of SOC: at so many of these they are 1 K wide.
const SOC_CELLS_AT_1_K: f64 = 240.0;
/// Full power passes at most this share of them in a step: in long steps fewer do.
const MOST_SHARE_OF_CELLS: f64 = 0.1;
/// Fewer prove nothing, and more take gigabytes.
const FEWEST_CELLS: usize = 20;
const MOST_CELLS: usize = 1000;
/// Cells that are not saved where there are many kinds of strings.
const NEEDED_CELLS: f64 = 160.0;
/// Rounding: share of the sums that is taken off the bound.
const ROUNDING: f64 = 1e-9;

/// Sizes of the cells.
#[derive(Debug, Clone, Copy)]
struct Fineness {
    soc_cells: usize,
    /// Widest cell of temperature [K].
    temperature_k: f64,
}

impl Fineness {
    fn of(problem: &PlanProblem<'_>, m: usize, soc_cells: f64) -> Self {
        let string = &problem.model.strings()[m];
        let p = &string.parameters;
        let middle = StringState { soc: 0.5 * (p.soc_min + p.soc_max), temperature_c: 25.0 };
        let volt = string.coefficients(Direction::Discharge, middle).voltage_v;
        let full_step = string.nominal_w() / volt * problem.intervals[0].dt_h / p.capacity_ah;
        let window = p.soc_max - p.soc_min;
        let most = MOST_SHARE_OF_CELLS * soc_cells * window / full_step.min(window);
        Self { soc_cells: soc_cells.min(most).ceil() as usize, temperature_k: SOC_CELLS_AT_1_K / soc_cells }
    }
}

/// What a string does at a corner: at a node of state, with the current of so many steps of SOC.
#[derive(Clone, Copy, Default)]
struct Corner {
    heat_w: f64,
    loss_w: f64,
    power_w: f64,
}

/// How far, within a box of states and currents, things may be off what lies linearly between its corners.
#[derive(Clone, Copy, Default)]
struct Shape {
    /// Heat below and above [W].
    heat_below_w: f64,
    heat_above_w: f64,
    /// Internal power, either way [W].
    internal_w: f64,
    /// Delivered power over internal power: below and above its chords [W].
    convex_w: f64,
    concave_w: f64,
    /// Largest difference of heat at one temperature, and of delivered power over temperature [W].
    heat_range_w: f64,
    power_range_w: f64,
    /// Least request that leads into the box, and most that is delivered in it [W].
    least_request_w: f64,
    most_power_w: f64,
}

/// Where a box leads in temperature: range, and the nodes of temperature inside.
#[derive(Clone, Copy, Default)]
struct Image {
    low_c: f64,
    high_c: f64,
    first: usize,
    last: usize,
}

/// What an inverter that runs below its own loss does: it charges nothing and draws on the battery.
#[derive(Clone, Copy, Default)]
struct Drawing {
    most_power_w: f64,
    least_loss_w: f64,
}

/// Everything about one direction that does not depend on prices. Corners are `(step of SOC, node)`, boxes
/// `(step of SOC, cell)`.
struct Moves {
    direction: Direction,
    /// Current of one step of SOC [A].
    current_a: f64,
    n_boxes: usize,
    corners: Vec<Corner>,
    shapes: Vec<Shape>,
    /// Smallest and largest slope of delivered over internal power.
    slopes: (f64, f64),
    drawing: Drawing,
    /// Largest SOC and heat that are drawn, for each cell.
    drawn: Vec<(f64, f64)>,
}

/// Where corners and boxes of an interval lead.
struct Images {
    interval: Interval,
    /// Cell of temperature and share of it, of each corner.
    corners: Vec<(usize, f64)>,
    boxes: Vec<Image>,
    /// Of strings that rest: of each node and cell of temperature.
    idle: Vec<(usize, f64)>,
    idle_boxes: Vec<Image>,
}

/// Delivered power over internal power, as the table has it; straight on at both ends.
struct Delivered {
    internal_w: Vec<f64>,
    power_w: Vec<f64>,
    direction: Direction,
}

impl Delivered {
    /// None where internal power does not rise with what is delivered.
    fn new(curve: &LossCurve) -> Option<Self> {
        let at = |(&p, &w): (&f64, &f64)| curve.internal_w(p, w);
        let internal_w: Vec<f64> = curve.power().iter().zip(curve.loss()).map(at).collect();
        let rises = internal_w.windows(2).zip(curve.power().windows(2));
        let steep = |(g, p): (&[f64], &[f64])| g[1] - g[0] > 0.01 * (p[1] - p[0]);
        (internal_w.len() > 1 && rises.into_iter().all(steep)).then(|| Self {
            internal_w,
            power_w: curve.power().to_vec(),
            direction: curve.direction(),
        })
    }

    fn slope(&self, segment: usize) -> f64 {
        (self.power_w[segment + 1] - self.power_w[segment])
            / (self.internal_w[segment + 1] - self.internal_w[segment])
    }

    fn slopes(&self) -> (f64, f64) {
        (0..self.power_w.len() - 1)
            .map(|s| self.slope(s))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), s| (low.min(s), high.max(s)))
    }

    fn at(&self, internal_w: f64) -> f64 {
        let last = self.power_w.len() - 2;
        let segment = self.internal_w.partition_point(|&g| g <= internal_w).saturating_sub(1).min(last);
        self.power_w[segment] + self.slope(segment) * (internal_w - self.internal_w[segment])
    }

    fn loss_w(&self, internal_w: f64, power_w: f64) -> f64 {
        match self.direction {
            Direction::Charge => power_w - internal_w,
            Direction::Discharge => internal_w - power_w,
        }
    }

    /// How far the curve may be below, and above, a mean of its values in a range.
    fn bends(&self, range: &Range) -> (f64, f64) {
        let (mut convex, mut concave) = (0.0, 0.0);
        let width = range.high - range.low;
        for (knot, &g) in
            self.internal_w.iter().enumerate().skip(1).take(self.power_w.len().saturating_sub(2))
        {
            if g > range.low && g < range.high {
                let bend =
                    (self.slope(knot) - self.slope(knot - 1)) * (g - range.low) * (range.high - g) / width;
                if bend > 0.0 {
                    convex += bend;
                } else {
                    concave -= bend;
                }
            }
        }
        (convex, concave)
    }
}

/// Nodes and cells of strings that are alike, and what they can do.
struct Kind<'a> {
    problem: &'a PlanProblem<'a>,
    /// One of them.
    member: usize,
    soc_min: f64,
    soc_step: f64,
    n_soc: usize,
    temperature_c: Vec<f64>,
    /// One over the derating factor, at each node of temperature.
    requests_per_power: Vec<f64>,
    /// Largest derating factor of each cell of temperature.
    largest_factor: Vec<f64>,
    moves: [Option<Moves>; 2],
    /// Share of the errors that is taken off: all of them, but for tests.
    share: f64,
}

fn which(direction: Direction) -> usize {
    match direction {
        Direction::Charge => 0,
        Direction::Discharge => 1,
    }
}

impl<'a> Kind<'a> {
    fn new(problem: &'a PlanProblem<'a>, members: &[usize], fineness: Fineness) -> Option<Self> {
        let member = members[0];
        let string = &problem.model.strings()[member];
        let p = &string.parameters;
        let temperature_c = temperatures(problem, members, fineness.temperature_k);
        let factor = &p.derating.factor;
        let factors: Vec<f64> = temperature_c.iter().map(|&c| factor.at(c)).collect();
        let n_soc = fineness.soc_cells + 1;
        let mut kind = Self {
            problem,
            member,
            soc_min: p.soc_min,
            soc_step: (p.soc_max - p.soc_min) / fineness.soc_cells as f64,
            n_soc,
            requests_per_power: factors.iter().map(|k| 1.0 / k.max(LEAST_FACTOR)).collect(),
            largest_factor: factors.windows(2).map(|k| k[0].max(k[1])).collect(),
            temperature_c,
            moves: [None, None],
            share: 1.0,
        };
        for direction in [Direction::Charge, Direction::Discharge] {
            let asked = |t: &usize| problem.intervals[*t].direction == direction && kind.cap_w(*t) > 0.0;
            let most_w = (0..problem.n_steps()).filter(asked).map(|t| kind.cap_w(t)).fold(0.0, f64::max);
            if most_w > 0.0 {
                kind.moves[which(direction)] = Some(kind.moves(direction, most_w)?);
            }
        }
        Some(kind)
    }

    fn string(&self) -> &StringModel {
        &self.problem.model.strings()[self.member]
    }

    /// Most that a string is asked for in a step [W].
    fn cap_w(&self, t: usize) -> f64 {
        self.problem.demand_w[t].min(self.problem.limit_w[self.member]) * (1.0 + ROUNDING)
    }

    fn n_temperatures(&self) -> usize {
        self.temperature_c.len()
    }

    fn n_nodes(&self) -> usize {
        self.n_soc * self.n_temperatures()
    }

    fn n_cells(&self) -> usize {
        (self.n_soc - 1) * (self.n_temperatures() - 1)
    }

    fn soc(&self, i: usize) -> f64 {
        self.soc_min + self.soc_step * i as f64
    }

    /// Node of SOC, `k` steps on.
    fn target(&self, direction: Direction, from: usize, k: usize) -> Option<usize> {
        match direction {
            Direction::Charge => Some(from + k).filter(|&to| to < self.n_soc),
            Direction::Discharge => from.checked_sub(k),
        }
    }

    /// Whether a triangle of a box ends within the window, and the middle node of SOC of those it may end at.
    fn middle(&self, direction: Direction, i: usize, k: usize) -> Option<usize> {
        match direction {
            Direction::Charge => Some(i + k + 1).filter(|&to| to < self.n_soc),
            Direction::Discharge => i.checked_sub(k),
        }
    }

    /// Corners of a box that lead to nodes, as nodes of SOC and steps; the two temperatures are the caller's.
    fn used(&self, direction: Direction, i: usize, k: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        [(i, k), (i + 1, k), (i, k + 1), (i + 1, k + 1)]
            .into_iter()
            .filter(move |&(i, k)| self.target(direction, i, k).is_some())
    }

    fn moves(&self, direction: Direction, most_w: f64) -> Option<Moves> {
        let string = self.string();
        let p = &string.parameters;
        let dt_h = self.problem.intervals[0].dt_h;
        let current_a = self.soc_step * p.capacity_ah / dt_h;
        let curve = string.loss(direction);
        let delivered = Delivered::new(curve)?;
        let n_temperatures = self.n_temperatures();
        // Voltage and resistance at each node; of each cell, how far they are from lying bilinearly between its nodes.
        let node =
            |i: usize, j: usize| StringState { soc: self.soc(i), temperature_c: self.temperature_c[j] };
        let at: Vec<(f64, f64)> = (0..self.n_nodes())
            .map(|x| {
                let c = string.coefficients(direction, node(x / n_temperatures, x % n_temperatures));
                (c.voltage_v, c.resistance_ohm)
            })
            .collect();
        let cells: Vec<(usize, usize)> =
            (0..self.n_soc - 1).flat_map(|i| (0..n_temperatures - 1).map(move |j| (i, j))).collect();
        let off: Vec<Off> = cells.iter().map(|&(i, j)| self.off(direction, i, j, &at)).collect();
        let drawing = Drawing {
            most_power_w: curve.largest_drawing_w(),
            least_loss_w: curve.loss().iter().copied().fold(f64::INFINITY, f64::min).max(0.0),
        };
        let most_drawn_w = (-delivered.internal_w[0]).max(0.0);
        let drawn = off.iter().map(|off| {
            let (v, r) = (off.voltage_v.low, off.resistance_ohm.high);
            let root = (1.0 - 4.0 * r * most_drawn_w / (v * v)).max(0.0).sqrt();
            let drawn_a = 2.0 * most_drawn_w / (v * (1.0 + root));
            (drawn_a * dt_h / p.capacity_ah, r * drawn_a * drawn_a)
        });
        let sign = if direction == Direction::Charge { 1.0 } else { -1.0 };
        let mut out = Moves {
            direction,
            current_a,
            n_boxes: 0,
            corners: vec![],
            shapes: vec![],
            slopes: delivered.slopes(),
            drawing,
            drawn: drawn.collect(),
        };
        let internal_w = |(v, r): (f64, f64), current_a: f64| current_a * (v + sign * r * current_a);
        let add_corners = |corners: &mut Vec<Corner>, k: usize| {
            let current_a = current_a * k as f64;
            corners.extend(at.iter().map(|&(v, r)| {
                let internal_w = internal_w((v, r), current_a);
                let power_w = delivered.at(internal_w);
                let loss_w = delivered.loss_w(internal_w, power_w);
                Corner { heat_w: r * current_a * current_a, loss_w, power_w }
            }));
        };
        add_corners(&mut out.corners, 0);
        for k in 0..self.n_soc - 1 {
            let (from_a, to_a) = (current_a * k as f64, current_a * (k + 1) as f64);
            let mut any = false;
            for (&(i, j), off) in cells.iter().zip(&off) {
                let lowest_v = off.voltage_v.low;
                let lowest_r = if direction == Direction::Charge {
                    off.resistance_ohm.low
                } else {
                    off.resistance_ohm.high
                };
                let least_w = delivered.at(internal_w((lowest_v, lowest_r), from_a)).max(0.0);
                let least_request_w = least_w / self.largest_factor[j];
                let possible = least_request_w <= most_w && self.middle(direction, i, k).is_some();
                if !possible {
                    out.shapes.push(Shape { least_request_w: f64::INFINITY, ..Shape::default() });
                    continue;
                }
                any = true;
                let (mut g, mut heat_range_w) =
                    (Range { low: f64::INFINITY, high: f64::NEG_INFINITY }, 0.0_f64);
                let mut power_range_w = 0.0_f64;
                for j in [j, j + 1] {
                    let mut heat = (f64::INFINITY, f64::NEG_INFINITY);
                    for (i, k) in self.used(direction, i, k) {
                        let (v, r) = at[i * n_temperatures + j];
                        let current_a = current_a * k as f64;
                        let internal_w = internal_w((v, r), current_a);
                        g = g.union(&Range::point(internal_w));
                        let heat_w = r * current_a * current_a;
                        heat = (heat.0.min(heat_w), heat.1.max(heat_w));
                    }
                    heat_range_w = heat_range_w.max(heat.1 - heat.0);
                }
                for (i, k) in self.used(direction, i, k) {
                    let power_w =
                        |j: usize| delivered.at(internal_w(at[i * n_temperatures + j], current_a * k as f64));
                    power_range_w = power_range_w.max((power_w(j + 1) - power_w(j)).abs());
                }
                // Between the corners of a triangle lie b (1 - b) and a b of its sides, at most 1/4 of their products.
                let product_w = 0.5 * off.resistance_change_ohm * to_a * current_a;
                let square = to_a * to_a;
                let heat_below_w = 0.25 * off.resistance_ohm.high * current_a * current_a
                    + product_w
                    + off.resistance_off_ohm.0 * square;
                let heat_above_w = product_w + off.resistance_off_ohm.1 * square;
                let internal_w = 0.25 * off.voltage_change_v * current_a
                    + off.voltage_off_v * to_a
                    + heat_below_w.max(heat_above_w);
                let (convex_w, concave_w) = delivered.bends(&g);
                let most_power_w = delivered.at(g.high) + out.slopes.1 * internal_w;
                out.shapes.push(Shape {
                    heat_below_w,
                    heat_above_w,
                    internal_w,
                    convex_w,
                    concave_w,
                    heat_range_w,
                    power_range_w,
                    least_request_w,
                    most_power_w: most_power_w.max(0.0),
                });
            }
            if !any {
                out.shapes.truncate(k * self.n_cells());
                break;
            }
            out.n_boxes = k + 1;
            add_corners(&mut out.corners, k + 1);
        }
        Some(out)
    }

    /// How far voltage and resistance in a cell are from lying between its nodes.
    fn off(&self, direction: Direction, i: usize, j: usize, at: &[(f64, f64)]) -> Off {
        let n_temperatures = self.n_temperatures();
        let soc = Range { low: self.soc(i), high: self.soc(i + 1) };
        let temperature_c = Range { low: self.temperature_c[j], high: self.temperature_c[j + 1] };
        let [low_low, low_high] = [at[i * n_temperatures + j], at[i * n_temperatures + j + 1]];
        let [high_low, high_high] = [at[(i + 1) * n_temperatures + j], at[(i + 1) * n_temperatures + j + 1]];
        let mut off = Off {
            voltage_v: Range::EMPTY,
            resistance_ohm: Range::EMPTY,
            voltage_change_v: (high_low.0 - low_low.0).abs().max((high_high.0 - low_high.0).abs()),
            resistance_change_ohm: (high_low.1 - low_low.1).abs().max((high_high.1 - low_high.1).abs()),
            voltage_off_v: 0.0,
            resistance_off_ohm: (0.0, 0.0),
        };
        let mut include = |v: f64, r: f64| {
            off.voltage_v = off.voltage_v.union(&Range::point(v));
            off.resistance_ohm = off.resistance_ohm.union(&Range::point(r));
        };
        for (v, r) in [low_low, low_high, high_low, high_high] {
            include(v, r);
        }
        for piece in self.string().pieces(direction, &StateBox { soc, temperature_c }) {
            for corner in self.string().corners(direction, &piece) {
                let (v, r) = (corner.voltage_v, corner.resistance_ohm);
                off.voltage_v = off.voltage_v.union(&Range::point(v));
                off.resistance_ohm = off.resistance_ohm.union(&Range::point(r));
                let a = (corner.soc - soc.low) / (soc.high - soc.low);
                let b = (corner.temperature_c - temperature_c.low) / (temperature_c.high - temperature_c.low);
                let between = |of: &dyn Fn((f64, f64)) -> f64| {
                    (1.0 - a) * ((1.0 - b) * of(low_low) + b * of(low_high))
                        + a * ((1.0 - b) * of(high_low) + b * of(high_high))
                };
                off.voltage_off_v = off.voltage_off_v.max((v - between(&|x| x.0)).abs());
                let resistance = r - between(&|x| x.1);
                off.resistance_off_ohm.0 = off.resistance_off_ohm.0.max(-resistance);
                off.resistance_off_ohm.1 = off.resistance_off_ohm.1.max(resistance);
            }
        }
        off
    }

    /// Temperature after an interval.
    fn after_c(&self, temperature_c: f64, heat_w: f64, interval: &Interval) -> f64 {
        self.string().warmed(temperature_c, heat_w, interval)
    }

    /// Cell of temperature and share of it; straight on beyond the ends.
    fn place(&self, temperature_c: f64) -> (usize, f64) {
        let nodes = &self.temperature_c;
        let cell = nodes.partition_point(|&c| c <= temperature_c).saturating_sub(1).min(nodes.len() - 2);
        (cell, (temperature_c - nodes[cell]) / (nodes[cell + 1] - nodes[cell]))
    }

    fn image(&self, low_c: f64, high_c: f64) -> Image {
        let nodes = &self.temperature_c;
        let inner = |node: usize| node.clamp(1, nodes.len() - 1);
        let first = inner(nodes.partition_point(|&c| c <= low_c));
        let last = inner(nodes.partition_point(|&c| c < high_c));
        Image { low_c, high_c, first, last: last.max(first) }
    }

    fn images(&self, interval: &Interval, moves: Option<&Moves>) -> Images {
        let n_temperatures = self.n_temperatures();
        let idle_c: Vec<f64> = self.temperature_c.iter().map(|&c| self.after_c(c, 0.0, interval)).collect();
        let rise = interval.dt_h * SECONDS_PER_HOUR * self.string().parameters.lumped.k1_k_per_j;
        let drawn_k = rise * moves.map_or(0.0, |m| m.drawn.iter().map(|d| d.1).fold(0.0, f64::max));
        let mut out = Images {
            interval: *interval,
            idle: idle_c.iter().map(|&c| self.place(c)).collect(),
            idle_boxes: idle_c.windows(2).map(|c| self.image(c[0], c[1] + drawn_k)).collect(),
            corners: vec![],
            boxes: vec![],
        };
        let Some(moves) = moves else { return out };
        let warmed: Vec<f64> = moves
            .corners
            .iter()
            .enumerate()
            .map(|(x, corner)| idle_c[x % n_temperatures] + rise * corner.heat_w)
            .collect();
        out.corners = warmed.iter().map(|&c| self.place(c)).collect();
        out.boxes.reserve(moves.shapes.len());
        for (x, shape) in moves.shapes.iter().enumerate() {
            if shape.least_request_w == f64::INFINITY {
                out.boxes.push(Image::default());
                continue;
            }
            let (k, cell) = (x / self.n_cells(), x % self.n_cells());
            let (i, j) = (cell / (n_temperatures - 1), cell % (n_temperatures - 1));
            let (mut low_c, mut high_c) = (f64::INFINITY, f64::NEG_INFINITY);
            for (i, k) in self.used(moves.direction, i, k) {
                let corner = k * self.n_nodes() + i * n_temperatures + j;
                low_c = low_c.min(warmed[corner]);
                high_c = high_c.max(warmed[corner + 1]);
            }
            out.boxes.push(self.image(low_c - rise * shape.heat_below_w, high_c + rise * shape.heat_above_w));
        }
        out
    }

    /// Solves backwards at prices `(T,)` [cost/Wh]; `each` sees the values of each step `(n_soc, n_temperature)`.
    fn backwards(&self, price: &[f64], mut each: impl FnMut(usize, &[f64])) -> Vec<f64> {
        let problem = self.problem;
        let n_temperatures = self.n_temperatures();
        let n_cells = self.n_cells();
        let mut next: Vec<f64> = (0..self.n_nodes())
            .map(|x| {
                let soc = self.soc(x / n_temperatures);
                problem.end_cost(self.member, StringState { soc, temperature_c: 25.0 })
            })
            .collect();
        each(problem.n_steps(), &next);
        let mut images: [Option<Images>; 2] = [None, None];
        let mut now = next.clone();
        let (mut plain_next, mut plain_now) = (next.clone(), next.clone());
        let mut bends = Bends::new(self);
        // Errors of the boxes that end with these currents, and of those that begin there.
        let (mut below, mut above) = (vec![0.0; n_cells], vec![0.0; n_cells]);
        for t in (0..problem.n_steps()).rev() {
            let interval = &problem.intervals[t];
            let which = which(interval.direction);
            let cap_w = self.cap_w(t);
            let moves = self.moves[which].as_ref().filter(|_| cap_w > 0.0);
            if !images[which].as_ref().is_some_and(|i| i.interval == *interval) {
                images[which] = Some(self.images(interval, self.moves[which].as_ref()));
            }
            let Some(images) = &images[which] else { unreachable!() };
            bends.of(self, &next);
            let step = StepPrices::new(self, t, price[t], moves);
            // Strings that rest, or draw on the battery for what the inverter loses.
            for (cell, below) in below.iter_mut().enumerate() {
                let (i, j) = (cell / (n_temperatures - 1), cell % (n_temperatures - 1));
                let image = &images.idle_boxes[j];
                let (mut error, slopes) = bends.over(self, i, image);
                let upper = bends.over(self, i + 1, image);
                error = error.max(upper.0);
                if let Some(moves) = moves.filter(|m| m.direction == Direction::Charge) {
                    let (soc, heat_w) = moves.drawn[cell];
                    let per_soc = bends.steepest(self, i, (soc / self.soc_step).ceil() as usize, image);
                    let earned = step.drawing[j] + step.rise * heat_w * (-slopes.0.min(upper.1 .0)).max(0.0);
                    error += (earned + per_soc * soc).max(0.0);
                }
                *below = error;
            }
            for x in 0..self.n_nodes() {
                let (i, j) = (x / n_temperatures, x % n_temperatures);
                let (cell, share) = images.idle[j];
                now[x] = lerp(&next[i * n_temperatures..], cell, share)
                    - self.share * self.largest_around(&below, i, j);
                plain_now[x] = lerp(&plain_next[i * n_temperatures..], cell, share);
            }
            if let Some(moves) = moves {
                below.fill(f64::NEG_INFINITY);
                for k in 0..=moves.n_boxes {
                    self.box_errors((moves, images), &bends, &step, (k, cap_w), &mut above);
                    let current_a = moves.current_a * k as f64;
                    let wear = step.dt_h * step.wear * current_a;
                    let mut any = false;
                    for i in 0..self.n_soc {
                        let Some(to) = self.target(moves.direction, i, k) else { continue };
                        let row = &next[to * n_temperatures..(to + 1) * n_temperatures];
                        let plain_row = &plain_next[to * n_temperatures..(to + 1) * n_temperatures];
                        for j in 0..n_temperatures {
                            let error =
                                self.largest_around(&below, i, j).max(self.largest_around(&above, i, j));
                            if error == f64::NEG_INFINITY {
                                continue;
                            }
                            any = true;
                            let x = i * n_temperatures + j;
                            let corner = &moves.corners[k * self.n_nodes() + x];
                            let (cell, share) = images.corners[k * self.n_nodes() + x];
                            let cost = step.cost(corner, j);
                            let value = cost + wear + lerp(row, cell, share) - self.share * error;
                            now[x] = now[x].min(value);
                            plain_now[x] = plain_now[x].min(cost + wear + lerp(plain_row, cell, share));
                        }
                    }
                    if !any && k > 0 {
                        break;
                    }
                    std::mem::swap(&mut below, &mut above);
                }
            }
            self.smooth(&mut now, &plain_now);
            std::mem::swap(&mut now, &mut next);
            std::mem::swap(&mut plain_now, &mut plain_next);
            each(t, &next);
        }
        next
    }

    /// Lowers values so that what they are below the plain ones bends little over temperature, against how these bend: a kink
    /// costs again in the step before, and would grow.
    fn smooth(&self, values: &mut [f64], plain: &[f64]) {
        let n = self.n_temperatures();
        let at = &self.temperature_c;
        let bend_at = |row: &[f64], j: usize| {
            let slope = |j: usize| (row[j + 1] - row[j]) / (at[j + 1] - at[j]);
            (slope(j) - slope(j - 1)).abs() / (at[j + 1] - at[j - 1])
        };
        let inner = 1..n - 1;
        let bends: f64 = plain.chunks_exact(n).flat_map(|row| inner.clone().map(|j| bend_at(row, j))).sum();
        let most = MOST_BEND * bends / (self.n_soc * inner.len().max(1)) as f64;
        let mut below = vec![0.0; n];
        for (values, plain) in values.chunks_exact_mut(n).zip(plain.chunks_exact(n)) {
            below.iter_mut().zip(plain.iter().zip(values.iter())).for_each(|(b, (p, v))| *b = p - v);
            for (j, value) in values.iter_mut().enumerate() {
                let less = |(c, below): (&f64, &f64)| below - most * (c - at[j]) * (c - at[j]);
                *value = plain[j] - at.iter().zip(&below).map(less).fold(f64::NEG_INFINITY, f64::max);
            }
        }
    }

    /// Errors of the boxes from `k` to `k + 1` steps of SOC `(cell,)`; minus infinity where nothing leads there.
    fn box_errors(
        &self,
        (moves, images): (&Moves, &Images),
        bends: &Bends,
        step: &StepPrices,
        (k, cap_w): (usize, f64),
        out: &mut [f64],
    ) {
        out.fill(f64::NEG_INFINITY);
        if k == moves.n_boxes {
            return;
        }
        let n_columns = self.n_temperatures() - 1;
        let from = k * self.n_cells();
        for i in 0..self.n_soc - 1 {
            let Some(middle) = self.middle(moves.direction, i, k) else { continue };
            for j in 0..n_columns {
                let cell = i * n_columns + j;
                let shape = &moves.shapes[from + cell];
                if shape.least_request_w > cap_w {
                    continue;
                }
                let (bend, (least, most)) = bends.around(self, middle, &images.boxes[from + cell]);
                let of_cost = step.heat * shape.heat_below_w
                    + step.steepest[j] * shape.internal_w
                    + (step.bend[j].1 * shape.convex_w).max(-step.bend[j].0 * shape.concave_w).max(0.0)
                    + step.uneven[j] * shape.most_power_w
                    + step.tilt[j] * shape.power_range_w;
                let of_value = (shape.heat_above_w * (-least).max(0.0))
                    .max(shape.heat_below_w * most.max(0.0))
                    + 0.25 * shape.heat_range_w * (most - least);
                out[cell] = step.dt_h * of_cost + step.rise * of_value + bend;
            }
        }
    }

    /// Largest error of the cells around a node.
    #[inline]
    fn largest_around(&self, errors: &[f64], i: usize, j: usize) -> f64 {
        let n_columns = self.n_temperatures() - 1;
        let (i0, i1) = (i.saturating_sub(1), i.min(self.n_soc - 2));
        let (j0, j1) = (j.saturating_sub(1), j.min(n_columns - 1));
        let at = |i: usize, j: usize| errors[i * n_columns + j];
        at(i0, j0).max(at(i0, j1)).max(at(i1, j0)).max(at(i1, j1))
    }

    /// Value at a state, from values at the nodes.
    fn at(&self, values: &[f64], state: StringState) -> f64 {
        let x = ((state.soc - self.soc_min) / self.soc_step).clamp(0.0, (self.n_soc - 1) as f64);
        let i = (x as usize).min(self.n_soc - 2);
        let share = x - i as f64;
        let (cell, of_cell) = self.place(state.temperature_c);
        let row = |i: usize| lerp(&values[i * self.n_temperatures()..], cell, of_cell);
        (1.0 - share) * row(i) + share * row(i + 1)
    }
}

/// Voltage and resistance of a cell: their ranges, their largest change over SOC, and how far they are from lying between
/// the nodes (resistance: below and above).
struct Off {
    voltage_v: Range,
    resistance_ohm: Range,
    voltage_change_v: f64,
    resistance_change_ohm: f64,
    voltage_off_v: f64,
    resistance_off_ohm: (f64, f64),
}

#[inline]
fn lerp(row: &[f64], cell: usize, share: f64) -> f64 {
    row[cell] + share * (row[cell + 1] - row[cell])
}

/// Prices of a step, and what follows for the errors in each cell of temperature.
struct StepPrices {
    dt_h: f64,
    heat: f64,
    loss: f64,
    wear: f64,
    /// Temperature per heat [K/W].
    rise: f64,
    /// Price of delivered power at each node of temperature.
    power: Vec<f64>,
    /// Largest slope of cost over internal power.
    steepest: Vec<f64>,
    /// Least and largest price of the bends of delivered power.
    bend: Vec<(f64, f64)>,
    /// Price of the most that is delivered, for the bend of one over the derating factor.
    uneven: Vec<f64>,
    /// Price of the change of delivered power over temperature.
    tilt: Vec<f64>,
    /// Most that is earned by an inverter that draws on the battery, less what it loses [cost].
    drawing: Vec<f64>,
}

impl StepPrices {
    /// Cost of a corner at a node of temperature.
    #[inline]
    fn cost(&self, corner: &Corner, j: usize) -> f64 {
        self.dt_h * (self.heat * corner.heat_w + self.loss * corner.loss_w + self.power[j] * corner.power_w)
    }

    fn new(kind: &Kind<'_>, t: usize, price: f64, moves: Option<&Moves>) -> Self {
        let costs = &kind.problem.prices.losses[t];
        let dt_h = kind.problem.intervals[t].dt_h;
        // Not below 0: asking for more than can be delivered never pays.
        let margin = costs.derating - price;
        let per_power = &kind.requests_per_power;
        let power: Vec<f64> = per_power.iter().map(|k| margin * k - costs.derating).collect();
        let mut out = Self {
            dt_h,
            heat: costs.battery,
            loss: costs.inverter,
            wear: kind.problem.prices.wear[kind.member],
            rise: dt_h * SECONDS_PER_HOUR * kind.string().parameters.lumped.k1_k_per_j,
            power,
            steepest: vec![],
            bend: vec![],
            uneven: vec![],
            tilt: vec![],
            drawing: vec![],
        };
        let Some(moves) = moves else { return out };
        let sign = if moves.direction == Direction::Charge { 1.0 } else { -1.0 };
        for (power, per_power) in out.power.windows(2).zip(per_power.windows(2)) {
            let (low, high) = (power[0].min(power[1]), power[0].max(power[1]));
            let bend = (low + sign * costs.inverter, high + sign * costs.inverter);
            let slope = |bend: f64, of_power: f64| (bend * of_power - sign * costs.inverter).abs();
            let steepest = [
                (bend.0, moves.slopes.0),
                (bend.0, moves.slopes.1),
                (bend.1, moves.slopes.0),
                (bend.1, moves.slopes.1),
            ]
            .into_iter()
            .map(|(bend, of_power)| slope(bend, of_power))
            .fold(0.0, f64::max);
            out.bend.push(bend);
            out.steepest.push(steepest);
            out.uneven.push(margin * (per_power[1].sqrt() - per_power[0].sqrt()).powi(2));
            out.tilt.push(0.25 * margin * (per_power[1] - per_power[0]).abs());
            let drawing = &moves.drawing;
            out.drawing.push(
                dt_h * ((-low).max(0.0) * drawing.most_power_w - costs.inverter * drawing.least_loss_w),
            );
        }
        out
    }
}

/// Slopes of the values over temperature, and how much they rise from cell to cell.
struct Bends {
    /// `(n_soc, cells of temperature)`.
    slope: Vec<f64>,
    /// `(n_soc, n_temperature)`, not negative.
    rise: Vec<f64>,
    /// Least and largest slope, and largest rise, of a node of SOC and those beside it.
    least: Vec<f64>,
    most: Vec<f64>,
    largest: Vec<f64>,
    /// Largest slopes over SOC `(cells of SOC, n_temperature)`.
    over_soc: Vec<f64>,
}

impl Bends {
    fn new(kind: &Kind<'_>) -> Self {
        let (nodes, columns) = (kind.n_nodes(), kind.n_soc * (kind.n_temperatures() - 1));
        Self {
            slope: vec![0.0; columns],
            rise: vec![0.0; nodes],
            least: vec![0.0; columns],
            most: vec![0.0; columns],
            largest: vec![0.0; nodes],
            over_soc: vec![0.0; nodes],
        }
    }

    fn of(&mut self, kind: &Kind<'_>, values: &[f64]) {
        let (n_soc, n) = (kind.n_soc, kind.n_temperatures());
        let columns = n - 1;
        for i in 0..n_soc {
            for j in 0..columns {
                let width = kind.temperature_c[j + 1] - kind.temperature_c[j];
                self.slope[i * columns + j] = (values[i * n + j + 1] - values[i * n + j]) / width;
            }
            for j in 1..columns {
                self.rise[i * n + j] =
                    (self.slope[i * columns + j] - self.slope[i * columns + j - 1]).max(0.0);
            }
            if i + 1 < n_soc {
                for j in 0..n {
                    self.over_soc[i * n + j] = (values[(i + 1) * n + j] - values[i * n + j]) / kind.soc_step;
                }
            }
        }
        for i in 0..n_soc {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(n_soc - 1));
            for j in 0..columns {
                let at = |i: usize| self.slope[i * columns + j];
                self.least[i * columns + j] = at(before).min(at(i)).min(at(after));
                self.most[i * columns + j] = at(before).max(at(i)).max(at(after));
            }
            for j in 1..columns {
                let at = |i: usize| self.rise[i * n + j];
                self.largest[i * n + j] = at(before).max(at(i)).max(at(after));
            }
        }
    }

    /// How far a mean of values at one SOC is above the value at the mean, in an image; least and largest slope.
    fn over(&self, kind: &Kind<'_>, i: usize, image: &Image) -> (f64, (f64, f64)) {
        Self::within(kind, i, image, &self.rise, (&self.slope, &self.slope))
    }

    /// The same of a node of SOC and those beside it.
    #[inline]
    fn around(&self, kind: &Kind<'_>, i: usize, image: &Image) -> (f64, (f64, f64)) {
        Self::within(kind, i, image, &self.largest, (&self.least, &self.most))
    }

    #[inline]
    fn within(
        kind: &Kind<'_>,
        i: usize,
        image: &Image,
        rises: &[f64],
        (least, most): (&[f64], &[f64]),
    ) -> (f64, (f64, f64)) {
        let n = kind.n_temperatures();
        let (least, most) = (&least[i * (n - 1)..(i + 1) * (n - 1)], &most[i * (n - 1)..(i + 1) * (n - 1)]);
        let rises = &rises[i * n..(i + 1) * n];
        let (mut low, mut high) = (least[image.first - 1], most[image.first - 1]);
        let mut bend = 0.0;
        for j in image.first..image.last {
            let node_c = kind.temperature_c[j];
            bend += rises[j] * (node_c - image.low_c) * (image.high_c - node_c);
            low = low.min(least[j]);
            high = high.max(most[j]);
        }
        (bend / (image.high_c - image.low_c), (low, high))
    }

    /// Largest slope over SOC, at least 0, of a cell of SOC and `further` ones below, in an image.
    fn steepest(&self, kind: &Kind<'_>, i: usize, further: usize, image: &Image) -> f64 {
        let n = kind.n_temperatures();
        let rows = i.saturating_sub(further)..=i;
        let columns = image.first - 1..=image.last.min(n - 1);
        rows.flat_map(|i| columns.clone().map(move |j| self.over_soc[i * n + j])).fold(0.0, f64::max)
    }
}

/// Nodes of temperature that no schedule leaves: knots of the tables, and others so that no cell is wider than `widest_k`.
fn temperatures(problem: &PlanProblem<'_>, members: &[usize], widest_k: f64) -> Vec<f64> {
    let string = &problem.model.strings()[members[0]];
    let p = &string.parameters;
    let ambients = problem.intervals.iter().map(|i| i.ambient_c);
    let starts = members.iter().map(|&m| problem.start[m].temperature_c);
    let (low, high) = ambients
        .clone()
        .chain(starts)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
    let hottest_c = ambients.fold(f64::NEG_INFINITY, f64::max);
    let factor = &p.derating.factor;
    let knots = || factor.x().iter().copied();
    // What the strings can warm to in one step more, in parts in which the derating factor is nearly one.
    let soc = Range { low: p.soc_min, high: p.soc_max };
    let most_w = problem.demand_w.iter().copied().fold(0.0, f64::max).min(problem.limit_w[members[0]]);
    let mut reached = (low, high);
    let mut top = high;
    for _ in 0..problem.n_steps() {
        let mut borders: Vec<f64> = knots().filter(|&k| k > reached.0 && k < reached.1).collect();
        borders.insert(0, reached.0);
        borders.push(reached.1);
        let mut warmest = top;
        for border in borders.windows(2) {
            let states = StateBox { soc, temperature_c: Range { low: border[0], high: border[1] } };
            for direction in [Direction::Charge, Direction::Discharge] {
                let interval = Interval { direction, ambient_c: hottest_c, ..problem.intervals[0] };
                let requests = Range { low: 0.0, high: most_w };
                warmest = warmest.max(string.cell(&states, &requests, &interval).end.temperature_c.high);
            }
        }
        if warmest <= top {
            break;
        }
        reached = (top, warmest);
        top = warmest;
    }
    let (low, top) = (low - 1e-6, top.max(low + 1.0) + 1e-6);
    let mut borders = vec![low, top];
    borders.extend(knots().filter(|&k| k > low && k < top));
    borders.sort_unstable_by(f64::total_cmp);
    borders.dedup();
    let mut out = vec![low];
    for border in borders.windows(2) {
        let derates = factor.at(border[1]) < 1.0 && factor.at(border[0]) > LEAST_FACTOR;
        let widest_k = if derates { widest_k / DERATING_CELLS } else { widest_k };
        let n = ((border[1] - border[0]) / widest_k).ceil().max(1.0);
        out.extend((1..=n as usize).map(|k| border[0] + (border[1] - border[0]) * k as f64 / n));
    }
    out
}

/// Lower bound of the cost of every schedule on the control model with the coefficients of the start of each step, from
/// prices of the balance `(T,)` [cost/Wh]. Starts and imbalance are left out; they only add to the cost.
///
/// `soc_cells` is how fine it looks at strings that are all alike; work grows with its third power. None where reactive power is
/// asked for, or where the internal power of an inverter does not rise with what it delivers.
pub(crate) fn bound(problem: &PlanProblem<'_>, price: &[f64], soc_cells: usize) -> Option<f64> {
    let kinds = kinds(problem);
    let cells = soc_cells.clamp(FEWEST_CELLS, MOST_CELLS) as f64;
    let cells = cells.min((cells / (kinds.len() as f64).cbrt()).max(NEEDED_CELLS));
    proven(problem, price, &kinds, |m| Fineness::of(problem, m, cells))
}

/// Strings in service that are alike.
fn kinds(problem: &PlanProblem<'_>) -> Vec<Vec<usize>> {
    let mut kinds: Vec<Vec<usize>> = vec![];
    for m in (0..problem.n_strings()).filter(|&m| problem.limit_w[m] > 0.0) {
        match kinds.iter_mut().find(|kind| problem.alike(kind[0], m)) {
            Some(kind) => kind.push(m),
            None => kinds.push(vec![m]),
        }
    }
    kinds
}

fn proven(
    problem: &PlanProblem<'_>,
    price: &[f64],
    kinds: &[Vec<usize>],
    fineness: impl Fn(usize) -> Fineness,
) -> Option<f64> {
    if problem.has_reactive() {
        return None;
    }
    let losses = &problem.prices.losses;
    let price: Vec<f64> =
        price.iter().zip(losses).map(|(l, c)| l.min(c.availability).min(c.derating)).collect();
    let demand = |t: usize| price[t] * problem.demand_w[t] * problem.intervals[t].dt_h;
    let idle = (0..problem.n_strings()).filter(|&m| problem.limit_w[m] <= 0.0);
    let mut terms: Vec<f64> = (0..problem.n_steps()).map(demand).collect();
    terms.extend(idle.map(|m| problem.end_cost(m, problem.start[m])));
    for members in kinds {
        let kind = Kind::new(problem, members, fineness(members[0]))?;
        let values = kind.backwards(&price, |_, _| ());
        terms.extend(members.iter().map(|&m| kind.at(&values, problem.start[m])));
    }
    let size: f64 = terms.iter().map(|x| x.abs()).sum();
    Some(terms.iter().sum::<f64>() - ROUNDING * size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{ControlModel, Losses};
    use crate::plan::{dual, Prices};
    use crate::search::common;

    const COARSE: Fineness = Fineness { soc_cells: 40, temperature_k: 4.0 };

    /// Kilowatts asked of each string, positive in discharge; states; ambient; limits.
    struct Given {
        demand_kw: Vec<f64>,
        dt_h: f64,
        soc: Vec<f64>,
        temperature_c: f64,
        ambient_c: f64,
        limit_kw: Vec<f64>,
    }

    impl Given {
        fn new(demand_kw: Vec<f64>, soc: Vec<f64>, temperature_c: f64) -> Self {
            let limit_kw = vec![92.0; soc.len()];
            Self { demand_kw, dt_h: 0.25, soc, temperature_c, ambient_c: temperature_c, limit_kw }
        }

        fn problem<'a>(&self, model: &'a ControlModel) -> PlanProblem<'a> {
            let demand_w: Vec<f64> =
                self.demand_kw.iter().map(|kw| kw * 1e3 * self.soc.len() as f64).collect();
            let interval = |&w: &f64| Interval {
                direction: Direction::of(w),
                ambient_c: self.ambient_c,
                dt_h: self.dt_h,
            };
            let losses = |t: usize| Losses {
                availability: 3e-3 * 0.99_f64.powi(t as i32),
                derating: 3e-3,
                inverter: 1e-3,
                battery: 1e-3,
            };
            let prices = Prices {
                losses: (0..demand_w.len()).map(losses).collect(),
                wear: vec![1e-4; self.soc.len()],
                start: 0.1,
                balance: 0.0,
                end_charge: -1e-3,
            };
            let start = self.soc.iter().map(|&soc| StringState { soc, temperature_c: self.temperature_c });
            let intervals = demand_w.iter().map(interval).collect();
            let demand_w: Vec<f64> = demand_w.iter().map(|w| w.abs()).collect();
            let limit_w = self.limit_kw.iter().map(|kw| kw * 1e3).collect();
            let running = vec![false; self.soc.len()];
            PlanProblem::new(model, start.collect(), running, &demand_w, intervals, limit_w, prices).unwrap()
        }
    }

    /// Hours of charge and discharge [kW].
    fn steps(blocks: &[(usize, f64)]) -> Vec<f64> {
        blocks.iter().flat_map(|&(n, kw)| vec![kw; n]).collect()
    }

    fn prices(problem: &PlanProblem<'_>) -> Vec<f64> {
        let known = problem.n_strings() as f64 * 50.0;
        dual::ascend(problem, vec![5e-5; problem.n_steps()], known, 8).price
    }

    /// What a string pays in a step of the control model with the coefficients of its start [cost], and where it ends.
    fn paid(
        problem: &PlanProblem<'_>,
        m: usize,
        t: usize,
        state: StringState,
        request_w: f64,
    ) -> (f64, StringState) {
        let interval = &problem.intervals[t];
        let flow = problem.model.strings()[m].step(state, request_w, interval);
        let p = &problem.prices;
        let rate = flow.losses().cost(&p.losses[t]) + p.wear[m] * flow.current_a.abs();
        (rate * interval.dt_h, flow.end)
    }

    /// Of random steps, states and requests, how many pay less than the values say, for a share of the errors.
    fn violations(given: &Given, share: f64, tries: usize) -> usize {
        let model = ControlModel::new(&common::reference(given.soc.len()));
        let problem = given.problem(&model);
        let price: Vec<f64> = prices(&problem).iter().map(|l| l.min(1.5e-3)).collect();
        let mut kind = Kind::new(&problem, &[0, 1], COARSE).unwrap();
        kind.share = share;
        let mut values = vec![vec![]; problem.n_steps() + 1];
        kind.backwards(&price, |t, v| values[t] = v.to_vec());
        let mut random = fastrand::Rng::with_seed(3);
        let (coolest, warmest) = (kind.temperature_c[0], kind.temperature_c[kind.n_temperatures() - 1]);
        let mut found = 0;
        for _ in 0..tries {
            let t = random.usize(0..problem.n_steps());
            let soc = match random.u8(0..8) {
                0 => 0.0,
                1 => 1.0,
                2 => 0.05 * random.f64(),
                _ => random.f64(),
            };
            let state = StringState { soc, temperature_c: coolest + (warmest - coolest) * random.f64() };
            let largest_w = problem.demand_w[t].min(problem.limit_w[0]);
            let request_w = match random.u8(0..8) {
                0 => largest_w,
                1 => 2e3 * random.f64(),
                _ => largest_w * random.f64(),
            };
            let (cost, end) = paid(&problem, 0, t, state, request_w.min(largest_w));
            let reached =
                cost - price[t] * request_w.min(largest_w) * given.dt_h + kind.at(&values[t + 1], end);
            found += usize::from(kind.at(&values[t], state) > reached + 1e-9);
        }
        found
    }

    #[test]
    fn no_step_of_the_control_model_pays_less_than_the_values_say_and_half_the_errors_would_not_do() {
        let mild = steps(&[(4, -39.0), (2, -5.0), (2, 0.0), (6, 60.0), (2, 10.0)]);
        let hot = steps(&[(6, 85.0), (1, 0.0), (6, -85.0)]);
        for given in [Given::new(mild, vec![0.5; 2], 25.0), Given::new(hot, vec![0.3; 2], 47.0)] {
            assert_eq!(violations(&given, 1.0, 150_000), 0);
            let seen = violations(&given, 0.5, 150_000);
            assert!(seen > 100, "{seen}");
        }
    }

    /// Each demand shared in a random way, and over time in the same way or not; costs are those of a roll-out.
    fn cheapest(problem: &PlanProblem<'_>, tries: usize) -> f64 {
        let mut random = fastrand::Rng::with_seed(5);
        let n = problem.n_strings();
        let mut best = f64::INFINITY;
        for try_ in 0..tries {
            let keep = random.f64();
            let mut weights: Vec<f64> = vec![1.0; n];
            let mut states = problem.start.clone();
            let mut cost = 0.0;
            for t in 0..problem.n_steps() {
                if try_ > 0 && random.f64() > keep {
                    let even = random.bool();
                    weights.iter_mut().for_each(|w| *w = if even { 1.0 } else { random.f64().powi(6) });
                }
                let mut left_w = problem.demand_w[t];
                let mut order: Vec<usize> = (0..n).collect();
                order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
                for (place, &m) in order.iter().enumerate() {
                    let weight: f64 = order[place..].iter().map(|&m| weights[m]).sum();
                    let later_w: f64 = order[place + 1..].iter().map(|&m| problem.limit_w[m]).sum();
                    let share_w = left_w * weights[m] / weight;
                    let request_w =
                        share_w.min(problem.limit_w[m]).max(left_w - later_w).clamp(0.0, problem.limit_w[m]);
                    left_w -= request_w;
                    let (paid, end) = paid(problem, m, t, states[m], request_w);
                    cost += paid;
                    states[m] = end;
                }
                assert!(left_w.abs() < 1e-6 * problem.demand_w[t].max(1.0));
            }
            cost += (0..n).map(|m| problem.end_cost(m, states[m])).sum::<f64>();
            best = best.min(cost);
        }
        best
    }

    #[test]
    fn no_schedule_costs_less_than_the_bound() {
        let day = steps(&[(6, -39.0), (2, 0.0), (8, 39.0), (2, 12.0), (4, -70.0)]);
        let mut cases = vec![
            Given::new(day.clone(), vec![0.5, 0.5], 25.0),
            Given::new(day.clone(), vec![0.4, 0.6, 0.9], -5.0),
            Given::new(day.clone(), vec![0.5, 0.2], 44.0),
            Given::new(steps(&[(12, 80.0)]), vec![0.05, 0.3], 25.0),
            Given::new(steps(&[(12, -80.0)]), vec![0.99, 0.7], 25.0),
            Given::new(vec![39.0], vec![0.5, 0.5], 25.0),
            Given::new(vec![0.001, -0.001, 0.0005], vec![0.5, 0.5], 25.0),
            Given::new(vec![0.0; 3], vec![0.5, 0.5], 25.0),
        ];
        cases[1].limit_kw[2] = 0.0;
        cases[2].limit_kw[0] = 60.0;
        cases.push(Given { dt_h: 1.0 / 60.0, ..Given::new(day.repeat(3), vec![0.5, 0.5], 25.0) });
        cases.push(Given { ambient_c: 45.0, ..Given::new(day, vec![0.5, 0.5], 30.0) });
        for (case, given) in cases.iter().enumerate() {
            let mut system = common::reference(given.soc.len());
            if case % 2 == 1 {
                system = system
                    .aged(&vec![1.0, 0.8, 0.9][..given.soc.len()], &vec![1.0, 1.5, 1.2][..given.soc.len()])
                    .unwrap();
            }
            let model = ControlModel::new(&system);
            let problem = given.problem(&model);
            let price = prices(&problem);
            let cost = cheapest(&problem, 400);
            for factor in [1.0, 0.3, 20.0, -1.0] {
                let price: Vec<f64> = price.iter().map(|l| l * factor).collect();
                let bound = proven(&problem, &price, &kinds(&problem), |_| COARSE).unwrap();
                assert!(bound <= cost, "case {case}: a bound of {bound}, a schedule of {cost}");
            }
        }
    }

    #[test]
    fn at_rated_demand_a_proof_takes_less_than_a_tenth_off_the_bound_of_the_grid() {
        let day = steps(&[(10, -39.0), (2, -15.0), (2, 0.0), (19, 39.0), (3, 15.0), (2, 0.0), (10, -39.0)]);
        let model = ControlModel::new(&common::reference(2));
        let mut problem = Given::new(day, vec![0.5; 2], 25.0).problem(&model);
        (problem.prices.end_charge, problem.prices.wear, problem.prices.start) = (0.0, vec![0.0; 2], 0.0);
        let dual = dual::ascend(&problem, vec![4e-5; problem.n_steps()], 30.0, 40);
        let bound = bound(&problem, &dual.price, 160).unwrap();
        assert!(0.9 * dual.bound < bound && bound < dual.bound, "{bound} of {}", dual.bound);
    }
}
