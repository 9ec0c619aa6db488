//! Response of the whole plant, as one store, to each of several constant powers over some control steps.

use bess_tables::{Axis, Direction, InputError, Lut};

use crate::error::{check_length, check_range};
use crate::model::{ControlModel, Interval, StringState};

const NEGLIGIBLE_KWH: f64 = 1e-12;

/// State of the plant as one store.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StoreState {
    /// Energy above the lower SOC limits [kWh].
    pub energy_kwh: f64,
    /// Mean temperature [degC].
    pub temperature_c: f64,
    /// Depth of the present discharge, relative to capacity.
    pub depth: f64,
}

/// The plant as one store: its grid of states, and the powers of its strings at each power of the plant.
#[derive(Debug, Clone)]
pub struct StoreGrid {
    /// Grid points of the stored energy [kWh], two at least.
    pub energy_kwh: Axis,
    /// Grid points of the mean temperature [degC], likewise.
    pub temperature_c: Axis,
    /// Grid points of the depth of the present discharge; one if wear is independent of it.
    pub depth: Axis,
    /// SOC of each string at each energy `(E, M)`.
    pub soc: Vec<f64>,
    /// Powers of the plant `(P,)` [kW], signed.
    pub power_kw: Vec<f64>,
    /// Their allocation to the strings `(P, M)` [W], signed.
    pub request_w: Vec<f64>,
    /// Energy of each string over its SOC [kWh].
    pub energies: Vec<Lut>,
    /// Share of each string in the mean temperature.
    pub mass_share: Vec<f64>,
    /// Standby of each string that is off [kW].
    pub off_kw: Vec<f64>,
    /// Energy of a discharge of depth 1 [kWh].
    pub capacity_kwh: f64,
    /// Control step [h].
    pub dt_h: f64,
    /// Parts of a control step in the midpoint rule.
    pub parts: usize,
    /// Ambient temperature of the transitions [degC].
    pub ambient_c: f64,
    /// Rate at which the plant approaches another ambient temperature [1/h].
    pub cooling_per_h: f64,
    /// Whether cycles count the mean of charged and discharged AC energy; otherwise energy that leaves the store.
    pub by_throughput: bool,
}

/// Mean powers over a block [kW], and the state at its end.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Flows {
    /// Request without the availability loss, signed.
    pub request_kw: f64,
    delivered_kw: f64,
    derated_kw: f64,
    standby_kw: f64,
    energy_kwh: f64,
    temperature_c: f64,
}

/// Energies of a block, and the state after it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SettledBlock {
    /// Energy discharged, charged with standby, and lost by derating [kWh], and stored energy times hours [kWh h].
    pub amounts: [f64; 4],
    /// Share of capacity discharged.
    pub drawn: f64,
    /// Energy that counts as cycled [kWh].
    pub cycled_kwh: f64,
    pub after: StoreState,
}

/// Rows of successive energies that end in successive cells of the grid, or all in the same cell, for example if they fill or
/// empty the store.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    /// First row, and number of rows.
    pub row: usize,
    pub rows: usize,
    /// Grid point below the end of the first row in depth, temperature and energy.
    pub place: usize,
    /// Cells from a row to the next, 0 or 1.
    pub stride: usize,
}

impl Run {
    /// The run with a next row that ends above `place`, if it continues the run.
    fn extended(&self, place: usize) -> Option<Self> {
        let stride = if self.rows == 1 { place.checked_sub(self.place)? } else { self.stride };
        let continues = stride < 2 && place == self.place + self.rows * stride;
        continues.then_some(Self { rows: self.rows + 1, stride, ..*self })
    }
}

/// Transitions of a block: rows in the order (temperature, power, energy).
#[derive(Debug, Default)]
pub(super) struct Transitions {
    pub hours: f64,
    /// Response of the plant temperature to a difference in ambient temperature, as a share.
    pub cooled: f64,
    pub flows: Vec<Flows>,
    /// Lowest and highest temperature at the end, from each temperature `(K,)`.
    pub ends_c: Vec<(f64, f64)>,
    /// The fields of [`SettledBlock`] for each row.
    pub amounts: [Vec<f64>; 4],
    /// Whether a row of each temperature and power has some of each amount `(K, P)`.
    pub has_some: Vec<[bool; 4]>,
    pub drawn: Vec<f64>,
    pub cycled_kwh: Vec<f64>,
    /// Position of the end of each row in its cell, by energy and by temperature.
    pub energy: Vec<f64>,
    pub temperature: Vec<f64>,
    /// Position by depth, from each depth at the start `(D, rows)`.
    pub depth: Vec<f64>,
    /// Runs from each depth and temperature `(D, K)`.
    pub runs: Vec<Vec<Run>>,
}

/// Weights of the corners of a cell, the first number first.
#[inline]
pub(super) fn weights(first: f64, second: f64) -> [f64; 4] {
    let (f, s) = (1.0 - first, 1.0 - second);
    [f * s, first * s, f * second, first * second]
}

impl StoreGrid {
    /// Checks the lengths of all arrays.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, a grid has fewer points than it needs, or a number is not finite.
    pub fn check(&self, model: &ControlModel) -> Result<(), InputError> {
        let n_strings = model.strings().len();
        for (name, points) in [("energy", &self.energy_kwh), ("temperature", &self.temperature_c)] {
            check_length(name, points, points.len().max(2))?;
        }
        check_length("power", &self.power_kw, self.power_kw.len().max(1))?;
        check_range("parts", &[self.parts as f64], (1.0, f64::MAX), "")?;
        check_length("soc", &self.soc, self.energy_kwh.len() * n_strings)?;
        check_length("request", &self.request_w, self.power_kw.len() * n_strings)?;
        check_length("energies", &self.energies, n_strings)?;
        check_length("mass_share", &self.mass_share, n_strings)?;
        check_length("off", &self.off_kw, n_strings)?;
        for soc in self.soc.chunks_exact(n_strings.max(1)) {
            model.states(soc, &vec![self.temperature_c[0]; n_strings])?;
        }
        self.request_w.chunks_exact(n_strings.max(1)).try_for_each(|row| model.directions(row, 1).map(|_| ()))
    }

    pub(super) fn n_states(&self) -> usize {
        self.energy_kwh.len() * self.temperature_c.len() * self.depth.len()
    }

    pub(super) fn transitions(&self, model: &ControlModel, steps: usize) -> Transitions {
        let (energies, temperatures) = (self.energy_kwh.len(), self.temperature_c.len());
        let hours = steps as f64 * self.dt_h;
        let cooled = 1.0 - (-self.cooling_per_h * hours).exp();
        let mut out = Transitions { hours, cooled, ..Transitions::default() };
        for &temperature_c in self.temperature_c.iter() {
            for p in 0..self.power_kw.len() {
                out.flows.extend((0..energies).map(|e| self.flows(model, e, temperature_c, p, steps)));
            }
        }
        let of_temperature = out.flows.chunks_exact(energies * self.power_kw.len());
        let include = |(low, high): (f64, f64), flows: &Flows| {
            (low.min(flows.temperature_c), high.max(flows.temperature_c))
        };
        out.ends_c = of_temperature
            .map(|flows| flows.iter().fold((f64::INFINITY, f64::NEG_INFINITY), include))
            .collect();
        let mut cells = Vec::with_capacity(out.flows.len());
        for flows in &out.flows {
            let (low, energy) = self.energy_kwh.locate(flows.energy_kwh);
            let (cool, temperature) = self.temperature_c.locate(flows.temperature_c);
            cells.push(cool * energies + low);
            out.energy.push(energy);
            out.temperature.push(temperature);
        }
        for (d, &depth) in self.depth.iter().enumerate() {
            for (row, flows) in out.flows.iter().enumerate() {
                let settled = self.settle(flows, self.energy_kwh[row % energies], depth, hours);
                if d == 0 {
                    out.amounts.iter_mut().zip(settled.amounts).for_each(|(all, amount)| all.push(amount));
                    out.drawn.push(settled.drawn);
                    out.cycled_kwh.push(settled.cycled_kwh);
                }
                let (low, share) = self.depth.locate(settled.after.depth);
                out.depth.push(share);
                let place = low * temperatures * energies + cells[row];
                if row % (energies * self.power_kw.len()) == 0 {
                    out.runs.push(Vec::new());
                }
                let runs = out.runs.last_mut().expect("one");
                let last = runs.last_mut().filter(|_| row % energies > 0);
                match last.and_then(|run| Some((run.extended(place)?, run))) {
                    Some((extended, run)) => *run = extended,
                    None => runs.push(Run { row, rows: 1, place, stride: 1 }),
                }
            }
        }
        let some = |from: usize| {
            out.amounts.each_ref().map(|all| all[from..from + energies].iter().any(|&amount| amount != 0.0))
        };
        out.has_some = (0..out.flows.len()).step_by(energies).map(some).collect();
        out
    }

    /// Response to a power from a grid point, all strings at one temperature.
    fn flows(&self, model: &ControlModel, e: usize, temperature_c: f64, p: usize, steps: usize) -> Flows {
        let n_strings = self.energies.len();
        let power_kw = self.power_kw[p];
        let direction = Direction::of(power_kw);
        let interval = Interval { direction, ambient_c: self.ambient_c, dt_h: self.dt_h / self.parts as f64 };
        let parts = steps * self.parts;
        let mut out = Flows::default();
        let mut shed_w = 0.0;
        for (m, string) in model.strings().iter().enumerate() {
            let limits = &string.parameters;
            let soc = self.soc[e * n_strings + m].clamp(limits.soc_min, limits.soc_max);
            let mut state = StringState { soc, temperature_c };
            let request_w = self.request_w[p * n_strings + m].abs().min(string.nominal_w());
            for _ in 0..parts {
                let flow = string.step_midpoint(state, request_w, &interval);
                out.delivered_kw += flow.delivered_w;
                out.derated_kw += flow.derating_w;
                shed_w += flow.availability_w;
                state = flow.end;
            }
            if request_w == 0.0 {
                out.standby_kw += self.off_kw[m];
            }
            out.energy_kwh += self.energies[m].at(state.soc);
            out.temperature_c += self.mass_share[m] * state.temperature_c;
        }
        let kilowatts = 1e-3 / parts as f64;
        out.request_kw = direction.sign() * (power_kw.abs() - kilowatts * shed_w).max(0.0);
        out.delivered_kw *= direction.sign() * kilowatts;
        out.derated_kw *= kilowatts;
        // A transition that overfills the store is used in part, until the store is full.
        let (held, full) = (self.energy_kwh[e], self.energy_kwh[self.energy_kwh.len() - 1]);
        let rise = out.energy_kwh - held;
        let part = 1.0 - (out.energy_kwh - full).max(0.0) / rise.max(1e-9);
        for power in [&mut out.request_kw, &mut out.delivered_kw, &mut out.derated_kw, &mut out.standby_kw] {
            *power *= part;
        }
        out.energy_kwh = held + part * rise;
        out
    }

    pub(super) fn settle(&self, flows: &Flows, held_kwh: f64, depth: f64, hours: f64) -> SettledBlock {
        let (sold, bought) = (flows.delivered_kw.max(0.0), (-flows.delivered_kw).max(0.0));
        let change = (flows.energy_kwh - held_kwh) / self.capacity_kwh;
        let (drawn, filled, held) = ((-change).max(0.0), change.max(0.0), held_kwh / self.capacity_kwh);
        // Charged energy has depth 0: the new depth is the mean over stored and charged energy.
        let after = if filled > 0.0 {
            (depth - filled).max(0.0) * held / (held + filled).max(NEGLIGIBLE_KWH)
        } else {
            depth + drawn
        };
        SettledBlock {
            amounts: [sold, bought + flows.standby_kw, flows.derated_kw, flows.energy_kwh].map(|a| hours * a),
            drawn,
            cycled_kwh: if self.by_throughput {
                0.5 * hours * (sold + bought)
            } else {
                drawn * self.capacity_kwh
            },
            after: StoreState {
                energy_kwh: flows.energy_kwh,
                temperature_c: flows.temperature_c,
                depth: after.min(self.depth[self.depth.len() - 1]),
            },
        }
    }
}

impl Transitions {
    /// Flows of a power from any state, interpolated between grid points.
    pub fn between(&self, grid: &StoreGrid, state: &StoreState, p: usize) -> Flows {
        let (energies, powers) = (grid.energy_kwh.len(), grid.power_kw.len());
        let (e, energy) = grid.energy_kwh.locate(state.energy_kwh);
        let (t, temperature) = grid.temperature_c.locate(state.temperature_c);
        let mut out = Flows::default();
        let below = (t * powers + p) * energies + e;
        let rows = [below, below + 1, below + powers * energies, below + powers * energies + 1];
        for (weight, row) in weights(energy, temperature).into_iter().zip(rows) {
            let flows = &self.flows[row];
            out.request_kw += weight * flows.request_kw;
            out.delivered_kw += weight * flows.delivered_kw;
            out.derated_kw += weight * flows.derated_kw;
            out.standby_kw += weight * flows.standby_kw;
            out.energy_kwh += weight * flows.energy_kwh;
            out.temperature_c += weight * flows.temperature_c;
        }
        out
    }
}
