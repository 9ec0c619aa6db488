//! Dispatch over prices: a dynamic program of the plant as one store, over stored energy, temperature and depth of the
//! present discharge.
//!
//! `transitions` holds the response of the control model to each of several powers, `dynamic_program` the backward and the
//! forward pass, and `bellman` its inner loop. The value of a state is the best income from there to the end of the horizon.
//! Values after a block are expected over the price levels of the next one. Where cycles are limited, values are computed for
//! several shadow prices of cycling; the dual value at a state is their minimum, each with the value of the remaining
//! cycles. Powers in kW, energies in kWh, money in EUR.

mod bellman;
mod dynamic_program;
mod transitions;

use std::collections::BTreeMap;

use bess_tables::{InputError, Lut};

use crate::error::{check_length, check_range};
use crate::model::ControlModel;
use dynamic_program::DynamicProgram;
use transitions::Transitions;
pub use transitions::{StoreGrid, StoreState};

/// Control steps of one price on one day.
#[derive(Debug, Clone, Copy)]
pub struct DispatchBlock {
    /// Number of control steps.
    pub steps: usize,
    /// Period of the cycle limit.
    pub period: usize,
    /// Mean ambient temperature [degC].
    pub ambient_c: f64,
    /// Whether a new price begins: the price level may change.
    pub is_new: bool,
}

/// A horizon of blocks `B` with price levels `L`.
#[derive(Debug, Clone)]
pub struct DispatchProblem {
    /// Blocks in order.
    pub blocks: Vec<DispatchBlock>,
    /// Income of a kWh discharged, of one charged, of one lost by derating, and of holding a kWh for an hour
    /// `(B, L + 1)`; the last level is the expected price.
    pub income_eur: Vec<[f64; 4]>,
    /// Probability of each level in each block `(B, L)`.
    pub share: Vec<f64>,
    /// Probability of each level (column) after each level (row).
    pub chance: Vec<f64>,
    /// Wear cost of a discharge over its depth.
    pub wear_eur: Lut,
    /// Value of a kWh stored at the end.
    pub end_eur_kwh: f64,
    /// Limit of the cycled energy of each period [kWh].
    pub allowed_kwh: Vec<f64>,
    /// Shadow prices of cycling, if a limit binds [EUR/kWh].
    pub shadow_prices_eur_kwh: Vec<f64>,
    /// State at the start.
    pub start: StoreState,
}

/// The plant as one store, with its transitions by the number of steps of a block.
#[derive(Debug)]
pub struct Store {
    model: ControlModel,
    grid: StoreGrid,
    transitions: BTreeMap<usize, Transitions>,
}

impl Store {
    /// A store on a control model.
    ///
    /// # Errors
    ///
    /// As [`StoreGrid::check`].
    pub fn new(model: ControlModel, grid: StoreGrid) -> Result<Self, InputError> {
        grid.check(&model)?;
        Ok(Self { model, grid, transitions: BTreeMap::new() })
    }

    /// Power of each block `(B,)` [kW], signed: the best without a price of cycling or, if it exceeds a limit, with the shadow
    /// prices.
    ///
    /// # Errors
    ///
    /// Lengths do not agree.
    pub fn dispatch(&mut self, problem: &DispatchProblem) -> Result<Vec<f64>, InputError> {
        let levels = problem.check()?;
        for block in &problem.blocks {
            let build = || self.grid.transitions(&self.model, block.steps);
            self.transitions.entry(block.steps).or_insert_with(build);
        }
        let solve = |shadow_eur: &[f64], allowed_kwh: &[f64]| {
            DynamicProgram::new(self, problem, levels, shadow_eur, allowed_kwh).solve()
        };
        let (power_kw, cycled_kwh) = solve(&[0.0], &vec![f64::INFINITY; problem.allowed_kwh.len()]);
        if cycled_kwh.iter().zip(&problem.allowed_kwh).all(|(cycled, allowed)| cycled <= allowed) {
            return Ok(power_kw);
        }
        Ok(solve(&problem.shadow_prices_eur_kwh, &problem.allowed_kwh).0)
    }

    fn of(&self, block: &DispatchBlock) -> &Transitions {
        &self.transitions[&block.steps]
    }

    /// Temperature difference after a block due to its ambient temperature, compared with its transition [K].
    fn ambient_shift_k(&self, block: &DispatchBlock) -> f64 {
        self.of(block).cooled * (block.ambient_c - self.grid.ambient_c)
    }
}

impl DispatchProblem {
    /// Wear cost of a discharge by `drawn` from `depth`, without the price of energy.
    fn wear_eur(&self, depth: f64, drawn: f64) -> f64 {
        if drawn == 0.0 {
            return 0.0;
        }
        self.wear_eur.at(depth + drawn) - self.wear_eur.at(depth)
    }

    /// Number of price levels, if all lengths agree.
    fn check(&self) -> Result<usize, InputError> {
        let blocks = self.blocks.len();
        let levels = self.share.len() / blocks.max(1);
        check_length("share", &self.share, levels.max(1) * blocks.max(1))?;
        check_length("chance", &self.chance, levels * levels)?;
        check_length("income", &self.income_eur, blocks * (levels + 1))?;
        check_length("shadow_prices", &self.shadow_prices_eur_kwh, self.shadow_prices_eur_kwh.len().max(1))?;
        let periods = self.blocks.iter().map(|block| block.period as f64).collect::<Vec<_>>();
        check_range("period", &periods, (0.0, self.allowed_kwh.len() as f64 - 1.0), "")?;
        Ok(levels)
    }
}
