//! Online rainflow counting (ASTM E1049-85, 5.4.4).
//!
//! A cycle is counted when the series passes the end of its range, not at the next reversal, so the count
//! at any time equals the count of the whole series; the ranges between the remaining points are open half cycles.

/// A reversal, the first value, or the last one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Point<P> {
    /// Value of the series.
    pub value: f64,
    /// Data of this point of time; of equal successive values, the last.
    pub data: P,
}

/// A full or a half cycle between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CountedCycle<P> {
    /// First point of the range.
    pub from: Point<P>,
    /// Second point.
    pub to: Point<P>,
    /// 1 or 0.5.
    pub count: f64,
}

/// The points of the open half cycles.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rainflow<P> {
    /// Two successive points are an open half cycle; the last point is the last value.
    pub points: Vec<Point<P>>,
}

impl<P: Copy> Rainflow<P> {
    /// Whether the series has a reversal before `value`.
    #[inline]
    pub fn turns_at(&self, value: f64) -> bool {
        match self.points[..] {
            [.., before, last] => (value - last.value) * (last.value - before.value) < 0.0,
            _ => false,
        }
    }

    /// Adds a value; completed cycles are passed to `counted`.
    #[inline]
    pub fn push(&mut self, value: f64, data: P, mut counted: impl FnMut(CountedCycle<P>)) {
        let point = Point { value, data };
        match self.points[..] {
            [first] if value == first.value => return,
            [] | [_] => {
                self.points.push(point);
                return;
            }
            _ if self.turns_at(value) => self.points.push(point),
            [.., _] => *self.points.last_mut().expect("two points at least") = point,
        }
        while let [.., a, b, c] = self.points[..] {
            if (c.value - b.value).abs() < (b.value - a.value).abs() {
                break;
            }
            if self.points.len() == 3 {
                counted(CountedCycle { from: a, to: b, count: 0.5 });
                self.points.remove(0);
            } else {
                counted(CountedCycle { from: a, to: b, count: 1.0 });
                self.points.truncate(self.points.len() - 3);
                self.points.push(c);
            }
        }
    }

    /// The open half cycles, as counted at the end of a series.
    pub fn open(&self) -> impl Iterator<Item = CountedCycle<P>> + '_ {
        self.points.windows(2).map(|pair| CountedCycle { from: pair[0], to: pair[1], count: 0.5 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(series: &[f64]) -> Vec<(f64, f64, usize, usize)> {
        let (mut rainflow, mut out) = (Rainflow::default(), Vec::new());
        for (index, &value) in series.iter().enumerate() {
            rainflow.push(value, index, |c| out.push(c));
        }
        out.extend(rainflow.open());
        out.iter().map(|c| ((c.to.value - c.from.value).abs(), c.count, c.from.data, c.to.data)).collect()
    }

    #[test]
    fn the_example_of_the_standard_is_reproduced() {
        let counted = count(&[-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]);
        let printed = [
            (3.0, 0.5, 0, 1),
            (4.0, 0.5, 1, 2),
            (4.0, 1.0, 4, 5),
            (8.0, 0.5, 2, 3),
            (9.0, 0.5, 3, 6),
            (8.0, 0.5, 6, 7),
            (6.0, 0.5, 7, 8),
        ];
        assert_eq!(counted, printed);
    }

    #[test]
    fn counted_and_open_cycles_have_the_throughput_of_the_series() {
        let series: Vec<f64> =
            (0..500).map(|i| (0.37 * f64::from(i)).sin() * (0.011 * f64::from(i)).cos()).collect();
        let travelled: f64 = series.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        let counted: f64 = count(&series).iter().map(|c| 2.0 * c.0 * c.1).sum();
        assert!((travelled - counted).abs() < 1e-12);
    }
}
