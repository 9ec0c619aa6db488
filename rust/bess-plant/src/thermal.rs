//! Heat along the air path: forward in time, central in space.
//!
//! `rho cp A T_t = k A T_xx + q(x) - U b (T - T_air(x))` on `n` cells of width `dx`. Per cell and step
//!
//! ```text
//! T_i += Fo (T_i-1 - 2 T_i + T_i+1) + heat_i - lateral (T_i - mean air in the cell)
//! mean air in the cell: T_i - (T_i - T_a,i) (1 - g) / ntu,   T_a,i+1 = T_i + (T_a,i - T_i) g,   g = exp(-ntu)
//! ```
//!
//! with `ntu = U b dx / (m cp)`. The air is quasi-steady. At both ends the flux passes half a cell and the
//! surface film in series (Robin), `U_end = 1 / (1/U + dx/2k)`, which keeps the scheme second order in space.
//! The form is conservative: heat that leaves one cell enters the next cell or the air.

use bess_tables::{Resistance, SpatialThermal};

use crate::lanes::{Lanes, WIDTH};
use crate::line::{Line, Lines, Margin};

/// Coefficients of the equation from the parameters of one string and the plant step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coefficients {
    /// `k dt / (rho cp dx^2)`.
    pub(crate) fourier: f64,
    /// `U b dt / (rho cp A)`.
    pub(crate) lateral: f64,
    /// `U_end dt / (rho cp dx)`.
    pub(crate) end: f64,
    /// `U_end A` of one pack [W/K].
    pub(crate) end_w_k: f64,
    /// `ntu` of one cell.
    pub(crate) ntu: f64,
    /// Temperature step of a node [K] per watt of string heat, were all of it in the node; nodes share by `R_i / n`.
    pub(crate) k_per_w: f64,
}

impl Coefficients {
    pub(crate) fn new(thermal: &SpatialThermal, step_s: f64) -> Self {
        let dx = thermal.length_m / thermal.nodes as f64;
        let heat_capacity_j_m3k = thermal.density_kg_m3 * thermal.specific_heat_j_kgk;
        let node_j_k = heat_capacity_j_m3k * thermal.section_m2 * dx;
        let lateral_w_mk = thermal.lateral_u_w_m2k * thermal.width_m;
        let (film, conduction) = (thermal.end_u_w_m2k, thermal.conductivity_w_mk / (0.5 * dx));
        let end_u_w_m2k = if film > 0.0 { film * conduction / (film + conduction) } else { 0.0 };
        Self {
            fourier: thermal.conductivity_w_mk * step_s / (heat_capacity_j_m3k * dx * dx),
            lateral: lateral_w_mk * step_s / (heat_capacity_j_m3k * thermal.section_m2),
            end: end_u_w_m2k * step_s / (heat_capacity_j_m3k * dx),
            end_w_k: end_u_w_m2k * thermal.section_m2,
            ntu: lateral_w_mk * dx / (thermal.air_flow_kg_s * thermal.air_cp_j_kgk),
            k_per_w: step_s / (node_j_k * thermal.nodes as f64 * f64::from(thermal.packs_per_string)),
        }
    }

    /// `2 Fo + lateral`, or the same sum of an end cell where that is larger. At most 1 in a stable plant.
    pub(crate) fn stability_number(&self) -> f64 {
        (2.0 * self.fourier).max(self.fourier + self.end) + self.lateral
    }

    /// The same at a share of the air flow. Still air is as warm as the cells and takes no heat.
    pub(crate) fn at_flow(self, share: f64) -> Self {
        Self { ntu: self.ntu / share, ..self }
    }

    fn air_decay(&self) -> f64 {
        (-self.ntu).exp()
    }

    /// `(1 - g) / ntu`, 1 where nothing goes to the air.
    fn mean_air_share(&self) -> f64 {
        if self.ntu > 0.0 {
            -(-self.ntu).exp_m1() / self.ntu
        } else {
            1.0
        }
    }
}

/// Node temperatures of the lanes and the resistance they cause.
#[derive(Debug, Clone)]
pub(crate) struct AirPath {
    fourier: Lanes,
    end: Lanes,
    /// `lateral (1 - g) / ntu`.
    to_air: Lanes,
    air_decay: Lanes,
    air_gain: Lanes,
    pub(crate) temperature: Vec<Lanes>,
    /// Resistance of a string with the temperature of the node throughout [Ohm].
    pub(crate) resistance: Vec<Lanes>,
    lines: Vec<Lines>,
    temperature_sum: Lanes,
    resistance_sum: Lanes,
    per_node: Lanes,
}

impl AirPath {
    pub(crate) fn new(coefficients: &[Coefficients; WIDTH], nodes: usize) -> Self {
        let each = |f: fn(&Coefficients) -> f64| Lanes::from_fn(|l| f(&coefficients[l]));
        Self {
            fourier: each(|c| c.fourier),
            end: each(|c| c.end),
            to_air: each(|c| c.lateral * c.mean_air_share()),
            air_decay: each(Coefficients::air_decay),
            air_gain: each(|c| 1.0 - c.air_decay()),
            temperature: vec![Lanes::ZERO; nodes],
            resistance: vec![Lanes::ZERO; nodes],
            lines: vec![Lines::unknown(); nodes],
            temperature_sum: Lanes::ZERO,
            resistance_sum: Lanes::ZERO,
            per_node: Lanes::splat(1.0 / nodes as f64),
        }
    }

    pub(crate) fn set_flow(&mut self, lane: usize, coefficients: &Coefficients) {
        self.to_air.0[lane] = coefficients.lateral * coefficients.mean_air_share();
        self.air_decay.0[lane] = coefficients.air_decay();
        self.air_gain.0[lane] = 1.0 - coefficients.air_decay();
    }

    /// Outlet temperature of air that enters at `inlet`, at the present node temperatures [degC].
    #[inline(always)]
    pub(crate) fn outlet(&self, inlet: Lanes) -> Lanes {
        self.temperature.iter().fold(inlet, |air, &node| self.air_decay * air + self.air_gain * node)
    }

    /// Warms every node equally [K], after [`Self::advance`]; `hottest` is raised to the hottest node.
    #[cold]
    #[inline(never)]
    pub(crate) fn warm(&mut self, rise: Lanes, mut hottest: Lanes, tables: &[&Resistance; WIDTH]) -> Lanes {
        for node in &mut self.temperature {
            *node = *node + rise;
            hottest = hottest.max(*node);
        }
        self.look_up(tables);
        hottest
    }

    #[inline(always)]
    pub(crate) fn mean_temperature(&self) -> Lanes {
        self.temperature_sum * self.per_node
    }

    /// Resistance of the string: its nodes are in series [Ohm].
    #[inline(always)]
    pub(crate) fn mean_resistance(&self) -> Lanes {
        self.resistance_sum * self.per_node
    }

    /// One plant step. `heating` [K/Ohm] times a node's resistance is its temperature step by heat; `hottest` is
    /// raised to the hottest node.
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        heating: Lanes,
        inlet: Lanes,
        hottest: Lanes,
        tables: &[&Resistance; WIDTH],
    ) -> Lanes {
        let last = self.temperature.len() - 1;
        let mut air = inlet;
        let mut here = self.temperature[0];
        let mut inflow = self.end * (inlet - here);
        let mut sums =
            Sums { temperature: Lanes::ZERO, resistance: Lanes::ZERO, hottest, margin: Margin::UNLIMITED };
        for node in 0..last {
            let next = self.temperature[node + 1];
            let outflow = self.fourier * (here - next);
            self.node(node, here, air, inflow - outflow, heating, &mut sums);
            air = self.air_decay * air + self.air_gain * here;
            (inflow, here) = (outflow, next);
        }
        let outlet = self.air_decay * air + self.air_gain * here;
        let outflow = self.end * (here - outlet);
        self.node(last, here, air, inflow - outflow, heating, &mut sums);

        self.temperature_sum = sums.temperature;
        self.resistance_sum = sums.resistance;
        if sums.margin.any_outside() {
            self.look_up(tables);
        }
        sums.hottest
    }

    #[inline(always)]
    fn node(
        &mut self,
        node: usize,
        here: Lanes,
        air: Lanes,
        conducted: Lanes,
        heating: Lanes,
        sums: &mut Sums,
    ) {
        let now = here + (conducted + (heating * self.resistance[node] - self.to_air * (here - air)));
        let resistance = self.lines[node].value(now);
        self.temperature[node] = now;
        self.resistance[node] = resistance;
        sums.temperature = sums.temperature + now;
        sums.resistance = sums.resistance + resistance;
        sums.hottest = sums.hottest.max(now);
        sums.margin = sums.margin.min(self.lines[node].margin(now));
    }

    /// Looks up the table segment of every node and sums up, in the order of [`Self::advance`].
    #[cold]
    #[inline(never)]
    pub(crate) fn look_up(&mut self, tables: &[&Resistance; WIDTH]) {
        (self.temperature_sum, self.resistance_sum) = (Lanes::ZERO, Lanes::ZERO);
        for node in 0..self.temperature.len() {
            let now = self.temperature[node];
            let r = self.lines[node].at(now, |lane, at| node_line(tables[lane], at));
            self.resistance[node] = r;
            self.temperature_sum = self.temperature_sum + now;
            self.resistance_sum = self.resistance_sum + r;
        }
    }
}

struct Sums {
    temperature: Lanes,
    resistance: Lanes,
    hottest: Lanes,
    margin: Margin,
}

/// Resistance over temperature of one node. Measured tables depend on SOC and current too: their nodes are
/// filled in at every step by the electrical model, so here any value does.
fn node_line(table: &Resistance, temperature_c: f64) -> Line {
    match table {
        Resistance::Switched { temperature, .. } => Line::of(temperature, temperature_c),
        Resistance::Measured { .. } => Line::constant(f64::NEG_INFINITY, f64::INFINITY, 0.0),
    }
}
