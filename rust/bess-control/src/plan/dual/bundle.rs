//! Proximal bundle method for the maximum of a concave function (Kiwiel, Math. Program. 46, 105, 1990).
//!
//! Each value with a supergradient is a plane above the function. The next point maximises the lowest of the planes, less a penalty
//! on the distance from the centre, the best point so far.

/// Minimum share of the predicted gain for a serious step, which moves the centre.
const SERIOUS_STEP_SHARE: f64 = 0.1;
/// Maximum factor by which one point changes the step length.
const MAX_LENGTH_CHANGE: f64 = 10.0;
/// Maximum number of weight exchanges, for each plane.
const EXCHANGES: usize = 30;
/// Relative difference of planes below which no weight is exchanged.
const TOLERANCE: f64 = 1e-12;

struct Plane {
    slope: Vec<f64>,
    /// Linearisation error: distance of plane and function at the centre.
    linearisation_error: f64,
    /// Weight in the step from the centre; all weights add to 1.
    weight: f64,
}

#[derive(Default)]
pub(super) struct Bundle {
    planes: Vec<Plane>,
    /// Products of the slopes of two planes.
    products: Vec<Vec<f64>>,
    /// The best point, its value and its plane.
    centre: Vec<f64>,
    value: f64,
    centre_plane: usize,
    /// Length of a step for a unit of slope; 0 before the first step.
    length: f64,
    predicted_gain: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Bundle {
    /// Adds a point with its value and a supergradient.
    pub(super) fn add(&mut self, point: Vec<f64>, value: f64, slope: Vec<f64>) {
        let index = self.planes.len();
        if index == 0 {
            (self.centre, self.value) = (point.clone(), value);
        }
        let moved: Vec<f64> = point.iter().zip(&self.centre).map(|(p, c)| p - c).collect();
        let gain = value - self.value;
        // With an inexact supergradient the function can exceed its plane.
        let mut linearisation_error = (value - dot(&slope, &moved) - self.value).max(0.0);
        let missed = 2.0 * (1.0 - gain / self.predicted_gain.max(f64::MIN_POSITIVE));
        let change = 1.0 / missed.max(1.0 / MAX_LENGTH_CHANGE);
        if gain > SERIOUS_STEP_SHARE * self.predicted_gain {
            for plane in &mut self.planes {
                plane.linearisation_error =
                    (plane.linearisation_error + dot(&plane.slope, &moved) - gain).max(0.0);
            }
            (self.centre, self.value, self.centre_plane, linearisation_error) = (point, value, index, 0.0);
            self.length *= change.max(1.0);
        } else if linearisation_error > self.predicted_gain {
            self.length *= change.clamp(1.0 / MAX_LENGTH_CHANGE, 1.0);
        }
        let row: Vec<f64> = self.planes.iter().map(|plane| dot(&plane.slope, &slope)).collect();
        self.products.iter_mut().zip(&row).for_each(|(products, &with)| products.push(with));
        self.products.push(row.into_iter().chain([dot(&slope, &slope)]).collect());
        self.planes.push(Plane { slope, linearisation_error, weight: if index == 0 { 1.0 } else { 0.0 } });
    }

    /// The next point. The first step is so long that the plane of the centre reaches `target`.
    pub(super) fn next(&mut self, target: f64) -> Vec<f64> {
        if self.length == 0.0 {
            let norm = self.products[self.centre_plane][self.centre_plane];
            self.length = (target - self.value).max(0.0) / norm.max(f64::MIN_POSITIVE);
        }
        self.solve_weights();
        let mut step = vec![0.0; self.centre.len()];
        for plane in &self.planes {
            step.iter_mut().zip(&plane.slope).for_each(|(sum, slope)| *sum += plane.weight * slope);
        }
        let linearisation_error: f64 =
            self.planes.iter().map(|plane| plane.weight * plane.linearisation_error).sum();
        self.predicted_gain = self.length * dot(&step, &step) + linearisation_error;
        self.centre.iter().zip(&step).map(|(centre, step)| centre + self.length * step).collect()
    }

    /// The best point and its value.
    pub(super) fn best(self) -> (Vec<f64>, f64) {
        (self.centre, self.value)
    }

    /// Weights of the planes: the dual of the problem of the next point, by exchanges between the planes that are lowest and highest
    /// after the step.
    fn solve_weights(&mut self) {
        let n = self.planes.len();
        let height = |i: usize| {
            let of = |j: usize| self.planes[j].weight * self.products[i][j];
            self.planes[i].linearisation_error + self.length * (0..n).map(of).sum::<f64>()
        };
        let mut heights: Vec<f64> = (0..n).map(height).collect();
        for _ in 0..EXCHANGES * n {
            let by_height = |&i: &usize, &j: &usize| heights[i].total_cmp(&heights[j]);
            let Some(to) = (0..n).min_by(by_height) else { return };
            let Some(from) = (0..n).filter(|&i| self.planes[i].weight > 0.0).max_by(by_height) else {
                return;
            };
            let distance = self.products[to][to] + self.products[from][from] - 2.0 * self.products[to][from];
            let difference = heights[from] - heights[to];
            if difference <= TOLERANCE * heights[from].abs() || distance <= 0.0 {
                return;
            }
            let weight = (difference / (self.length * distance)).min(self.planes[from].weight);
            self.planes[from].weight -= weight;
            self.planes[to].weight += weight;
            for (height, products) in heights.iter_mut().zip(&self.products) {
                *height += self.length * weight * (products[to] - products[from]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Minimum of the planes of a pyramid that is steep along one axis, with its top at (3, -1).
    fn pyramid(point: &[f64]) -> (f64, Vec<f64>) {
        let (x, y) = (point[0] - 3.0, point[1] + 1.0);
        let slope = vec![-x.signum(), -20.0 * y.signum()];
        (5.0 - x.abs() - 20.0 * y.abs(), slope)
    }

    #[test]
    fn the_top_of_a_pyramid_is_found_where_gradient_steps_oscillate() {
        let mut bundle = Bundle::default();
        let mut point = vec![-4.0, 6.0];
        for _ in 0..30 {
            let (value, slope) = pyramid(&point);
            bundle.add(point, value, slope);
            point = bundle.next(5.0);
        }
        let (best, value) = bundle.best();
        assert!(value > 5.0 - 1e-6, "{value} at {best:?}");
    }

    #[test]
    fn a_value_that_is_not_at_the_centre_never_lowers_the_best() {
        let mut bundle = Bundle::default();
        let (mut point, mut best) = (vec![9.0, 9.0], f64::NEG_INFINITY);
        for pass in 0..20 {
            let (value, slope) = pyramid(&point);
            bundle.add(point.clone(), value, slope);
            assert!(bundle.value >= best && bundle.value <= 5.0);
            best = bundle.value;
            // The first points are not from the bundle.
            point = if pass < 5 { vec![f64::from(pass), -3.0] } else { bundle.next(5.0) };
        }
    }
}
