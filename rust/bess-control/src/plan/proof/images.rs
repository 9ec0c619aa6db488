//! End temperatures of corners and boxes.

use bess_tables::units::SECONDS_PER_HOUR;

use super::moves::Moves;
use super::Kind;
use crate::model::Interval;

/// Image of a box under the thermal model: range of end temperatures, and the nodes inside.
#[derive(Clone, Copy, Default)]
pub(super) struct Image {
    pub(super) low_c: f64,
    pub(super) high_c: f64,
    pub(super) first: usize,
    pub(super) last: usize,
}

/// Images of the corners and boxes of an interval.
pub(super) struct Images {
    pub(super) interval: Interval,
    /// Temperature cell of each corner, and the position in it.
    pub(super) corners: Vec<(usize, f64)>,
    pub(super) boxes: Vec<Image>,
    /// Of idle strings: of each temperature node and cell.
    pub(super) idle: Vec<(usize, f64)>,
    pub(super) idle_boxes: Vec<Image>,
}

impl Kind<'_> {
    /// The temperature cell whose lower node is the last that is `below`: the first or the last cell beyond the ends. The linear search
    /// starts at `near`.
    fn cell(&self, near: usize, below: impl Fn(f64) -> bool) -> usize {
        let nodes = &self.temperature_c;
        let mut cell = near;
        while cell + 2 < nodes.len() && below(nodes[cell + 1]) {
            cell += 1;
        }
        while cell > 0 && !below(nodes[cell]) {
            cell -= 1;
        }
        cell
    }

    /// Temperature cell and position in it, extrapolated beyond the ends.
    pub(super) fn place(&self, temperature_c: f64, near: usize) -> (usize, f64) {
        let nodes = &self.temperature_c;
        let cell = self.cell(near, |c| c <= temperature_c);
        (cell, (temperature_c - nodes[cell]) / (nodes[cell + 1] - nodes[cell]))
    }

    /// Temperature cells and positions of a sequence of similar temperatures.
    fn places(&self, temperatures_c: impl Iterator<Item = f64>) -> Vec<(usize, f64)> {
        let mut near = 0;
        let place = |temperature_c| {
            let place = self.place(temperature_c, near);
            near = place.0;
            place
        };
        temperatures_c.map(place).collect()
    }

    pub(super) fn image(&self, low_c: f64, high_c: f64, near: usize) -> Image {
        let first = 1 + self.cell(near, |c| c <= low_c);
        let last = 1 + self.cell(first - 1, |c| c < high_c);
        Image { low_c, high_c, first, last: last.max(first) }
    }

    pub(super) fn images(&self, interval: &Interval, moves: Option<&Moves>) -> Images {
        let n_temperatures = self.n_temperatures();
        let idle_c: Vec<f64> =
            self.temperature_c.iter().map(|&c| self.string().warmed(c, 0.0, interval)).collect();
        let rise = interval.dt_h * SECONDS_PER_HOUR * self.string().parameters.lumped.k1_k_per_j;
        let drawn_k = rise * moves.map_or(0.0, |m| m.drawn.iter().map(|d| d.1).fold(0.0, f64::max));
        let mut out = Images {
            interval: *interval,
            idle: self.places(idle_c.iter().copied()),
            idle_boxes: idle_c.windows(2).map(|c| self.image(c[0], c[1] + drawn_k, 0)).collect(),
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
        out.corners = self.places(warmed.iter().copied());
        out.boxes.reserve(moves.errors.len());
        let mut near = 0;
        for (x, error) in moves.errors.iter().enumerate() {
            if error.min_request_w == f64::INFINITY {
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
            let image =
                self.image(low_c - rise * error.heat_below_w, high_c + rise * error.heat_above_w, near);
            near = image.first - 1;
            out.boxes.push(image);
        }
        out
    }
}
