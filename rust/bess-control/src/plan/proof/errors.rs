//! Interpolation errors: how far cost and value in a box of states and currents are at most below linear interpolation.

use bess_tables::units::SECONDS_PER_HOUR;

use super::images::{Image, Images};
use super::moves::{Corner, Moves};
use super::{Kind, MIN_FACTOR};
use crate::extremes::{larger, smaller};
use crate::model::{Losses, Range};

/// Prices of a step, and the resulting error terms of each temperature cell.
pub(super) struct StepPrices<'k> {
    kind: &'k Kind<'k>,
    /// Prices of the losses.
    costs: &'k Losses,
    dt_h: f64,
    /// Temperature per heat [K/W].
    rise: f64,
    /// Price of delivered power at each node of temperature.
    pub(super) power: Vec<f64>,
    /// Largest slope of cost over internal power.
    pub(super) steepest: Vec<f64>,
    /// Minimum and maximum price of the curvature of delivered power.
    pub(super) bend: Vec<(f64, f64)>,
    /// Price of the maximum delivered power, for the curvature of the reciprocal derating factor.
    pub(super) uneven: Vec<f64>,
    /// Price of the change of delivered power over temperature.
    pub(super) tilt: Vec<f64>,
    /// Gain of undelivered requests at each temperature node: during derating, a request with a price above its derating cost may
    /// pay off without any delivery.
    pub(super) shed_gain: Vec<f64>,
    /// Largest request [W].
    cap_w: f64,
    /// Largest net revenue of an inverter that discharges the battery below its no-load loss [cost].
    pub(super) drawing: Vec<f64>,
}

impl<'k> StepPrices<'k> {
    /// Cost of a corner at a node of temperature.
    #[inline]
    pub(super) fn cost(&self, corner: &Corner, j: usize) -> f64 {
        let room_w = larger(0.0, self.cap_w - corner.power_w * self.kind.requests_per_power[j]);
        self.dt_h
            * (self.costs.battery * corner.heat_w
                + self.costs.inverter * corner.loss_w
                + self.power[j] * corner.power_w
                - self.shed_gain[j] * room_w)
    }

    pub(super) fn new(kind: &'k Kind<'k>, t: usize, price: f64, moves: Option<&Moves>) -> Self {
        let costs = &kind.problem.prices.losses[t];
        let dt_h = kind.problem.dt_h();
        // If negative, derated requests gain more than they cost.
        let margin = costs.derating - price;
        let per_power = &kind.requests_per_power;
        let power: Vec<f64> = per_power.iter().map(|k| margin * k - costs.derating).collect();
        // Per request: lowest derating factor of a cell, or 0 below [`MIN_FACTOR`].
        let shed_gain = |k: &Range| {
            let k = if k.low < MIN_FACTOR { 0.0 } else { k.low };
            (-margin - k * (costs.availability - costs.derating).max(0.0)).max(0.0)
        };
        let shed_gain: Vec<f64> = kind.factor.iter().map(shed_gain).collect();
        let around = |j: usize| shed_gain[j.saturating_sub(1)].max(shed_gain[j.min(shed_gain.len() - 1)]);
        let shed_gain = (0..=kind.factor.len()).map(around).collect();
        let mut out = Self {
            kind,
            costs,
            dt_h,
            rise: dt_h * SECONDS_PER_HOUR * kind.string().parameters.lumped.k1_k_per_j,
            power,
            steepest: vec![],
            bend: vec![],
            uneven: vec![],
            tilt: vec![],
            shed_gain,
            cap_w: kind.cap_w(t),
            drawing: vec![],
        };
        let Some(moves) = moves else { return out };
        let sign = -moves.direction.sign();
        for (power, per_power) in out.power.windows(2).zip(per_power.windows(2)) {
            let (low, high) = (power[0].min(power[1]), power[0].max(power[1]));
            let bend = (low + sign * costs.inverter, high + sign * costs.inverter);
            let slope = |bend: f64, of_power: f64| (bend * of_power - sign * costs.inverter).abs();
            let slopes = [moves.slopes.low, moves.slopes.high];
            let steepest =
                slopes.map(|s| slope(bend.0, s).max(slope(bend.1, s))).into_iter().fold(0.0, f64::max);
            out.bend.push(bend);
            out.steepest.push(steepest);
            out.uneven.push(margin.max(0.0) * (per_power[1].sqrt() - per_power[0].sqrt()).powi(2));
            out.tilt.push(0.25 * margin.abs() * (per_power[1] - per_power[0]).abs());
            let revenue = (-low).max(0.0) * moves.max_drawing_w;
            out.drawing.push(dt_h * (revenue - costs.inverter * moves.min_drawing_loss_w));
        }
        out
    }
}

/// Slopes of the values over temperature, and their increase from cell to cell.
pub(super) struct Curvature {
    /// `(n_soc, cells of temperature)`.
    pub(super) slope: Vec<f64>,
    /// `(n_soc, n_temperature)`, not negative.
    pub(super) rise: Vec<f64>,
    /// Minimum and maximum slope, and maximum rise, at an SOC node and its neighbours.
    pub(super) min_slope: Vec<f64>,
    pub(super) max_slope: Vec<f64>,
    pub(super) max_rise: Vec<f64>,
    /// Maximum difference of slopes to the neighbouring SOC nodes, at the same temperature. `rise` covers kinks at one SOC;
    /// the remaining error of a mean over two SOC nodes depends on this difference alone.
    pub(super) across: Vec<f64>,
    /// Largest slopes over SOC `(cells of SOC, n_temperature)`.
    pub(super) over_soc: Vec<f64>,
}

impl Curvature {
    pub(super) fn new(kind: &Kind<'_>, values: &[f64]) -> Self {
        let (n_soc, n) = (kind.soc.len, kind.n_temperatures());
        let columns = n - 1;
        let ([nodes, cells], zeros) = ([n_soc * n, n_soc * columns], |n| vec![0.0; n]);
        let [mut slope, mut min_slope, mut max_slope, mut across] = [cells; 4].map(zeros);
        let [mut rise, mut max_rise, mut over_soc] = [nodes; 3].map(zeros);
        for i in 0..n_soc {
            for j in 0..columns {
                let width = kind.temperature_c[j + 1] - kind.temperature_c[j];
                slope[i * columns + j] = (values[i * n + j + 1] - values[i * n + j]) / width;
            }
            for j in 1..columns {
                rise[i * n + j] = (slope[i * columns + j] - slope[i * columns + j - 1]).max(0.0);
            }
            if i + 1 < n_soc {
                for j in 0..n {
                    over_soc[i * n + j] = (values[(i + 1) * n + j] - values[i * n + j]) / kind.soc.step;
                }
            }
        }
        for i in 0..n_soc {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(n_soc - 1));
            for j in 0..columns {
                let at = |i: usize| slope[i * columns + j];
                min_slope[i * columns + j] = at(before).min(at(i)).min(at(after));
                max_slope[i * columns + j] = at(before).max(at(i)).max(at(after));
                across[i * columns + j] = (at(i) - at(before)).abs().max((at(i) - at(after)).abs());
            }
            for j in 1..columns {
                let at = |i: usize| rise[i * n + j];
                max_rise[i * n + j] = at(before).max(at(i)).max(at(after));
            }
        }
        Self { slope, rise, min_slope, max_slope, max_rise, across, over_soc }
    }

    /// Excess of a mean of values at one SOC over the value at the mean, in an image; minimum and maximum slope.
    pub(super) fn over(&self, kind: &Kind<'_>, i: usize, image: &Image) -> (f64, (f64, f64)) {
        Self::within(kind, i, image, &self.rise, (&self.slope, &self.slope))
    }

    /// Like [`Self::over`], for an SOC node and its neighbours.
    #[inline]
    pub(super) fn around(&self, kind: &Kind<'_>, i: usize, image: &Image) -> (f64, (f64, f64)) {
        Self::within(kind, i, image, &self.max_rise, (&self.min_slope, &self.max_slope))
    }

    #[inline]
    pub(super) fn within(
        kind: &Kind<'_>,
        i: usize,
        image: &Image,
        rises: &[f64],
        (min_slope, max_slope): (&[f64], &[f64]),
    ) -> (f64, (f64, f64)) {
        let n = kind.n_temperatures();
        let (min_slope, max_slope) =
            (&min_slope[i * (n - 1)..(i + 1) * (n - 1)], &max_slope[i * (n - 1)..(i + 1) * (n - 1)]);
        let rises = &rises[i * n..(i + 1) * n];
        let (mut low, mut high) = (min_slope[image.first - 1], max_slope[image.first - 1]);
        let mut bend = 0.0;
        for j in image.first..image.last {
            let node_c = kind.temperature_c[j];
            bend += rises[j] * (node_c - image.low_c) * (image.high_c - node_c);
            low = smaller(low, min_slope[j]);
            high = larger(high, max_slope[j]);
        }
        (bend / (image.high_c - image.low_c), (low, high))
    }

    /// Maximum difference of slopes over temperature between an SOC node and its neighbours, in an image.
    #[inline]
    pub(super) fn across(&self, kind: &Kind<'_>, i: usize, image: &Image) -> f64 {
        let row = i * (kind.n_temperatures() - 1);
        self.across[row + image.first - 1..row + image.last].iter().copied().fold(0.0, larger)
    }

    /// Maximum slope over SOC, at least 0, of an SOC cell and the `further` cells below, in an image.
    pub(super) fn steepest(&self, kind: &Kind<'_>, i: usize, further: usize, image: &Image) -> f64 {
        let n = kind.n_temperatures();
        let rows = i.saturating_sub(further)..=i;
        let columns = image.first - 1..=image.last.min(n - 1);
        rows.flat_map(|i| columns.clone().map(move |j| self.over_soc[i * n + j])).fold(0.0, f64::max)
    }
}

/// Errors of a step in each cell `(cell,)`.
pub(super) struct Errors {
    /// Of strings that are off, or that start and take the inverter loss from the battery.
    pub(super) off: Vec<f64>,
    /// Of strings that run and take this loss from the battery; empty in discharge.
    pub(super) drawing: Vec<f64>,
    /// Of every box between the currents of two successive SOC steps.
    pub(super) boxes: Vec<Vec<f64>>,
}

impl Kind<'_> {
    /// Errors of strings that do not charge or discharge `(cell,)`, plus `more`.
    pub(super) fn idle_errors(
        &self,
        curvature: &Curvature,
        images: &Images,
        more: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        let n_columns = self.n_temperatures() - 1;
        let error = |cell: usize| {
            let (i, j) = (cell / n_columns, cell % n_columns);
            let image = &images.idle_boxes[j];
            curvature.over(self, i, image).0.max(curvature.over(self, i + 1, image).0) + more(cell)
        };
        (0..self.n_cells()).map(error).collect()
    }

    /// Maximum gain in a cell of an inverter that takes its loss from the battery, compared with an idle one; may be negative.
    pub(super) fn drawn(
        &self,
        moves: &Moves,
        curvature: &Curvature,
        images: &Images,
        step: &StepPrices<'_>,
        cell: usize,
    ) -> f64 {
        let (i, j) = (cell / (self.n_temperatures() - 1), cell % (self.n_temperatures() - 1));
        let image = &images.idle_boxes[j];
        let min_slope = |i: usize| curvature.over(self, i, image).1 .0;
        let (soc, heat_w) = moves.drawn[cell];
        let per_soc = curvature.steepest(self, i, (soc / self.soc.step).ceil() as usize, image);
        let warmer = step.rise * heat_w * (-min_slope(i).min(min_slope(i + 1))).max(0.0);
        step.drawing[j] + warmer + per_soc * soc
    }

    /// Errors of the boxes from `k` to `k + 1` steps of SOC `(cell,)`; minus infinity for unreachable boxes.
    pub(super) fn box_errors(
        &self,
        (moves, images): (&Moves, &Images),
        curvature: &Curvature,
        step: &StepPrices<'_>,
        k: usize,
    ) -> Vec<f64> {
        let mut out = vec![f64::NEG_INFINITY; self.n_cells()];
        let n_columns = self.n_temperatures() - 1;
        let from = k * self.n_cells();
        for i in 0..self.soc.len - 1 {
            let Some(middle) = self.middle(moves.direction, i, k) else { continue };
            for j in 0..n_columns {
                let cell = i * n_columns + j;
                let error = &moves.errors[from + cell];
                if error.min_request_w > step.cap_w {
                    continue;
                }
                let image = &images.boxes[from + cell];
                let (bend, (min_slope, max_slope)) = curvature.around(self, middle, image);
                let of_cost = step.costs.battery * error.heat_below_w
                    + step.steepest[j] * error.internal_w
                    + larger(0.0, larger(step.bend[j].1 * error.convex_w, -step.bend[j].0 * error.concave_w))
                    + step.uneven[j] * error.max_power_w
                    + step.tilt[j] * error.power_range_w;
                let of_value = larger(
                    error.heat_above_w * larger(0.0, -min_slope),
                    error.heat_below_w * larger(0.0, max_slope),
                ) + 0.25 * error.heat_range_w * curvature.across(self, middle, image);
                out[cell] = step.dt_h * of_cost + step.rise * of_value + bend;
            }
        }
        out
    }

    /// Largest error of the cells around a node.
    #[inline]
    pub(super) fn largest_around(&self, errors: &[f64], i: usize, j: usize) -> f64 {
        let n_columns = self.n_temperatures() - 1;
        let (i0, i1) = (i.saturating_sub(1), i.min(self.soc.len - 2));
        let (j0, j1) = (j.saturating_sub(1), j.min(n_columns - 1));
        let at = |i: usize, j: usize| errors[i * n_columns + j];
        larger(larger(at(i0, j0), at(i0, j1)), larger(at(i1, j0), at(i1, j1)))
    }
}
