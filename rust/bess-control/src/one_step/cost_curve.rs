//! Cost of one string in one interval as a function of its request, for the Lagrangian.

use bess_tables::Direction;

use crate::model::{heat_share, heat_w, LossCurve, Losses, Range};

/// Slopes with a smaller relative difference are equal.
const SLOPE_ROUNDING: f64 = 1e-9;

/// Feasible range and costs of a string in the interval.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OperatingTerms {
    pub direction: Direction,
    /// Upper limit of the request [W].
    pub limit_w: f64,
    /// Maximum deliverable AC power, for any request [W].
    pub deliverable_w: f64,
    /// Range of the derating factor, which takes its value of minimum cost.
    pub derating: Range,
    /// Range of `V^2 / R` [W], which takes its value of minimum cost at the price below.
    pub power_scale_w: Range,
    /// Price of `V^2 / R`, with the inverter on or off [1/W]: the sensitivity of the step's cost to the state.
    pub scale_price: f64,
    /// Price of internal power, in addition to its loss [1/W].
    pub power_price: f64,
    /// Costs of derating, inverter and battery loss [1/W]; `shed_cost` is the cost of shed power.
    pub costs: Losses,
    /// Minimum power of an inverter that is on [W]; of a derated request, a remainder below it may be shed.
    pub min_power_w: f64,
    /// Price of shed power [1/W], at least the cost of derating; infinite if no power may be shed.
    pub shed_cost: f64,
}

/// Dependence of the cheapest `V^2 / R` on the internal power.
#[derive(Debug, Clone, Copy)]
enum Scale {
    /// Constant [W].
    At(f64),
    /// `R I / V` is constant, so that heat and price are proportional to the power, with this factor.
    Proportional(f64),
}

/// Part of a segment of the loss table: delivered power `[p0, p1]`, on which loss and internal power are linear,
/// so that `q(p) = c_inverter w(p) + min_y (c_battery h(g(p), y) + price y)` is smooth and convex.
#[derive(Debug, Clone, Copy)]
struct Piece {
    p0: f64,
    p1: f64,
    g0: f64,
    scale: Scale,
    loss_slope: f64,
    q0: f64,
    q1: f64,
    slope0: f64,
    slope1: f64,
}

/// Response of a string to a price of the demand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Response {
    /// `min (cost - price * request)`.
    pub value: f64,
    /// Request at this minimum [W].
    pub request_w: f64,
    /// Availability loss of the request [W].
    pub shed_w: f64,
}

/// Cost of a string in a step over its request, in the Lagrangian.
pub(crate) trait StringCost {
    /// Response of a string whose inverter is on.
    fn on(&self, price: f64) -> Response;

    /// Response of a string whose inverter is off.
    fn off(&self, price: f64) -> Response;

    /// Highest finite slope of the cost; a scale for prices.
    fn steepest(&self) -> f64;

    /// Largest request without shedding, of an inverter that is on (off).
    fn largest_request(&self, on: bool) -> f64;

    /// Whether larger requests are possible, but shed.
    fn may_shed(&self) -> bool {
        false
    }

    /// Whether the inverter must be on.
    fn is_on(&self) -> bool {
        false
    }
}

/// One-step cost of a string. The request `u` splits into delivered `p`, derated `u - p - a` with
/// `p + a = k u`, and shed `a`; the cost is `c_derating (u - p - a) + q(p) + c_shed a`. No convexity is
/// assumed between segments: the Lagrangian depends on the convex envelope only.
#[derive(Debug, Clone)]
pub(crate) struct CostCurve {
    pub terms: OperatingTerms,
    pieces: Vec<Piece>,
    /// Pieces before this index deliver at most `k_min * limit`.
    split: usize,
    /// Whether slopes increase from piece to piece, so that there is only one minimum.
    convex: bool,
}

impl CostCurve {
    pub fn new(curve: &LossCurve, terms: OperatingTerms) -> Self {
        let mut out =
            Self { terms, pieces: Vec::with_capacity(curve.power().len() + 2), split: 0, convex: true };
        let deliverable = match terms.direction {
            Direction::Charge => terms.deliverable_w,
            Direction::Discharge => {
                terms.deliverable_w.min(curve.largest_power(0.25 * terms.power_scale_w.high))
            }
        };
        let max_w = deliverable.min(terms.derating.high * terms.limit_w);
        let guaranteed_w = terms.derating.low * terms.limit_w;
        let [from_g, to_g] = out.interior_range();
        for (p, w) in curve.power().windows(2).zip(curve.loss().windows(2)) {
            let slope = (w[1] - w[0]) / (p[1] - p[0]);
            let loss = |x: f64| w[0] + slope * (x - p[0]);
            let start = curve.internal_w(p[0], w[0]);
            let at = |g: f64| p[0] + (g - start) / out.internal_slope(slope);
            // Without a price of the scale, its upper end has the lowest cost at any power.
            let changes = if terms.scale_price > 0.0 { [0.0, from_g, to_g].map(at) } else { [p[1]; 3] };
            let [first, second, third] = changes;
            let mut ends =
                [guaranteed_w, first, second, third, p[1]].map(|x| if x < p[1] { x } else { p[1] });
            ends.sort_unstable_by(f64::total_cmp);
            let mut from = p[0];
            for to in ends.map(|end| end.min(max_w)) {
                if to > from {
                    out.push(curve, (from, loss(from)), (to, loss(to)), slope);
                    from = to;
                    if to <= guaranteed_w {
                        out.split = out.pieces.len();
                    }
                }
            }
        }
        out
    }

    /// `R I / V` at which the heat saved by a watt of `V^2 / R` equals its price: `dh/dy = -s^2 / (1 +- 2 s)`.
    fn balanced_share(&self) -> f64 {
        let ratio = self.terms.scale_price / self.terms.costs.battery;
        match self.terms.direction {
            // No heat can be saved: the smallest scale is the cheapest.
            _ if !ratio.is_finite() => f64::INFINITY,
            Direction::Charge => ratio + (ratio * ratio + ratio).sqrt(),
            Direction::Discharge => ratio / (ratio + (ratio * ratio + ratio).sqrt()).max(f64::MIN_POSITIVE),
        }
    }

    /// Range of internal power in which the cheapest `V^2 / R` is inside its range [W].
    fn interior_range(&self) -> [f64; 2] {
        let s = self.balanced_share();
        let per_scale =
            if s.is_infinite() { f64::INFINITY } else { s * (1.0 - self.terms.direction.sign() * s) };
        let Range { low, high } = self.terms.power_scale_w;
        [low * per_scale, high * per_scale]
    }

    fn push(&mut self, curve: &LossCurve, (p0, w0): (f64, f64), (p1, w1): (f64, f64), loss_slope: f64) {
        let (g0, g1) = (curve.internal_w(p0, w0), curve.internal_w(p1, w1));
        let Losses { inverter: c_inverter, battery: c_battery, .. } = self.terms.costs;
        let Range { low, high } = self.terms.power_scale_w;
        let [from_g, to_g] = self.interior_range();
        let middle = 0.5 * (g0 + g1);
        let (scale, price_of) = if self.terms.scale_price == 0.0 {
            (Scale::At(high), 0.0)
        } else if middle < 0.0 {
            // An inverter that draws from the battery in charge: heat at one end of the range, price at the other.
            (Scale::At(high), low)
        } else if middle <= from_g {
            (Scale::At(low), low)
        } else if middle >= to_g {
            (Scale::At(high), high)
        } else {
            (Scale::Proportional(self.heat_slope(self.balanced_share())), 0.0)
        };
        let heat = |g: f64| match scale {
            Scale::At(y) => heat_w(g, y, self.terms.direction),
            Scale::Proportional(factor) => factor * g,
        };
        let OperatingTerms { scale_price, power_price, .. } = self.terms;
        let q =
            |w: f64, g: f64| c_inverter * w + c_battery * heat(g) + power_price * g + scale_price * price_of;
        let internal_slope = self.internal_slope(loss_slope);
        let slope = |g: f64| {
            let heat_slope = match scale {
                _ if c_battery == 0.0 => 0.0,
                Scale::At(y) => self.heat_slope(heat_share(g / y, self.terms.direction)),
                Scale::Proportional(factor) => factor,
            };
            c_inverter * loss_slope + internal_slope * (c_battery * heat_slope + power_price)
        };
        let piece = Piece {
            p0,
            p1,
            g0,
            scale,
            loss_slope,
            q0: q(w0, g0),
            q1: q(w1, g1),
            slope0: slope(g0),
            slope1: slope(g1),
        };
        self.convex &= self
            .pieces
            .last()
            .is_none_or(|before| before.slope1 <= piece.slope0 + SLOPE_ROUNDING * piece.slope0.abs())
            && piece.slope0 <= piece.slope1;
        self.pieces.push(piece);
    }

    /// `dh/dg` at a share `R I / V`.
    #[inline]
    fn heat_slope(&self, share: f64) -> f64 {
        2.0 * share / (1.0 - self.terms.direction.sign() * (2.0 * share))
    }

    /// `dg/dp` on a segment.
    #[inline]
    fn internal_slope(&self, loss_slope: f64) -> f64 {
        1.0 + self.terms.direction.sign() * loss_slope
    }

    /// Price above which it is cheaper to accept the whole request and shed it.
    #[inline]
    fn shed_price(&self) -> f64 {
        let (k, c_derating) = (self.terms.derating.low, self.terms.costs.derating);
        if k > 0.0 {
            c_derating + (self.terms.shed_cost - c_derating) * k
        } else {
            c_derating
        }
    }

    /// Minimum of `q(p) + slope * p` over some pieces, and its location.
    #[inline]
    fn minimise(&self, range: std::ops::Range<usize>, slope: f64) -> (f64, f64) {
        let pieces = &self.pieces[range];
        if self.convex {
            let Some(last) = pieces.last() else { return (f64::INFINITY, 0.0) };
            // Counting in all of the few pieces is faster than a binary search with its dependent reads.
            return match pieces.get(pieces.iter().filter(|piece| piece.slope1 + slope < 0.0).count()) {
                None => (last.q1 + slope * last.p1, last.p1),
                Some(piece) if piece.slope0 + slope < 0.0 => self.stationary(piece, slope),
                Some(piece) => (piece.q0 + slope * piece.p0, piece.p0),
            };
        }
        let mut best = (f64::INFINITY, 0.0);
        for piece in pieces {
            let (at0, at1) = (piece.q0 + slope * piece.p0, piece.q1 + slope * piece.p1);
            if at0 < best.0 {
                best = (at0, piece.p0);
            }
            if at1 < best.0 {
                best = (at1, piece.p1);
            }
            if piece.slope0 + slope < 0.0 && piece.slope1 + slope > 0.0 {
                let inner = self.stationary(piece, slope);
                if inner.0 < best.0 {
                    best = inner;
                }
            }
        }
        best
    }

    #[inline]
    fn stationary(&self, piece: &Piece, slope: f64) -> (f64, f64) {
        let Scale::At(scale) = piece.scale else {
            // A linear piece has its minimum at an end.
            return (piece.q0 + slope * piece.p0, piece.p0);
        };
        let Losses { inverter: c_inverter, battery: c_battery, .. } = self.terms.costs;
        let direction = self.terms.direction;
        let internal_slope = self.internal_slope(piece.loss_slope);
        let linear = c_inverter * piece.loss_slope + self.terms.power_price * internal_slope;
        let heat_slope = -(slope + linear) / (c_battery * internal_slope);
        let x = match direction {
            Direction::Charge => 0.25 * ((1.0 - heat_slope).powi(-2) - 1.0),
            Direction::Discharge => 0.25 * (1.0 - (1.0 + heat_slope).powi(-2)),
        };
        let p = (piece.p0 + (x * scale - piece.g0) / internal_slope).clamp(piece.p0, piece.p1);
        let g = piece.g0 + internal_slope * (p - piece.p0);
        let heat_0 = heat_w(piece.g0, scale, direction);
        let heat = heat_w(g, scale, direction);
        let q = piece.q0 + linear * (p - piece.p0) + c_battery * (heat - heat_0);
        (q + slope * p, p)
    }

    /// Response of a string with its inverter on or off, whichever costs less.
    #[inline]
    pub fn free(&self, price: f64) -> Response {
        let (on, off) = (self.on(price), self.off(price));
        if on.value < off.value {
            on
        } else {
            off
        }
    }
}

impl StringCost for CostCurve {
    #[inline]
    fn off(&self, price: f64) -> Response {
        let OperatingTerms { limit_w, derating, power_scale_w, scale_price, costs, min_power_w, .. } =
            self.terms;
        let idle = scale_price * power_scale_w.low;
        let gain = self.shed_price() - price;
        let mut best = if gain < 0.0 {
            Response { value: idle + gain * limit_w, request_w: limit_w, shed_w: derating.low * limit_w }
        } else {
            Response { value: idle, request_w: 0.0, shed_w: 0.0 }
        };
        if derating.low < 1.0 && self.terms.shed_cost.is_infinite() {
            // The remainder of these requests after derating may be below the minimum power; it is shed at no
            // cost.
            let max_w = self.largest_request(false);
            for request_w in [(min_power_w / derating.high).min(max_w), max_w] {
                let derated_w = (request_w - min_power_w).max((1.0 - derating.high) * request_w);
                let value = idle + costs.derating * derated_w - price * request_w;
                if value < best.value {
                    best = Response { value, request_w, shed_w: 0.0 };
                }
            }
        }
        best
    }

    #[inline]
    fn on(&self, price: f64) -> Response {
        let OperatingTerms { limit_w, derating, shed_cost, costs, .. } = self.terms;
        let c_derating = costs.derating;
        if self.pieces.is_empty() {
            return Response { value: f64::INFINITY, request_w: 0.0, shed_w: 0.0 };
        }
        if price <= c_derating {
            // The smallest request for each delivered power.
            let slope = (c_derating - price) / derating.high - c_derating;
            let (value, p) = self.minimise(0..self.pieces.len(), slope);
            return Response { value, request_w: (p / derating.high).min(limit_w), shed_w: 0.0 };
        }
        let whole = (c_derating - price) * limit_w;
        let (above, _) = self.minimise(self.split..self.pieces.len(), -c_derating);
        let above = Response { value: above + whole, request_w: limit_w, shed_w: 0.0 };
        if self.split == 0 {
            return above;
        }
        let below = if price <= self.shed_price() {
            // The largest request for each delivered power without shedding.
            let (value, p) = self.minimise(0..self.split, (c_derating - price) / derating.low - c_derating);
            Response { value, request_w: (p / derating.low).min(limit_w), shed_w: 0.0 }
        } else {
            let (value, p) = self.minimise(0..self.split, -shed_cost);
            let guaranteed_w = derating.low * limit_w;
            let value = value + whole + (shed_cost - c_derating) * guaranteed_w;
            Response { value, request_w: limit_w, shed_w: (guaranteed_w - p).max(0.0) }
        };
        if above.value < below.value {
            above
        } else {
            below
        }
    }

    fn steepest(&self) -> f64 {
        let finite = |s: f64| if s.is_finite() { s.abs() } else { 0.0 };
        let ends = self.pieces.iter().map(|p| finite(p.slope0).max(finite(p.slope1)));
        ends.fold(self.terms.costs.derating, f64::max)
    }

    fn largest_request(&self, on: bool) -> f64 {
        let OperatingTerms { limit_w, derating, min_power_w, .. } = self.terms;
        let k = derating.low;
        if k <= 0.0 {
            return limit_w;
        }
        let delivered = match self.pieces.last() {
            Some(piece) if on => piece.p1,
            _ if k < 1.0 => min_power_w,
            _ => 0.0,
        };
        (delivered / k).min(limit_w)
    }

    fn may_shed(&self) -> bool {
        self.terms.shed_cost.is_finite()
    }
}
