//! The state of a plant: set, get and checks.

use bess_tables::{InputError, System};

use super::{Plant, ROUNDING};
use crate::ageing::{AgeingState, StringAgeing};
use crate::check::{check_all, check_range, SOH_CAPACITY, SOH_RESISTANCE, TEMPERATURE_C};
use crate::cooling::CoolingState;

/// Complete state of a plant: a plant restored from it continues bit by bit.
///
/// Lanes are `scenario * n_strings + string`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantState {
    /// State of charge of each lane.
    pub soc: Vec<f64>,
    /// Node temperatures [degC], `max_nodes` for each lane; a string with fewer nodes leaves the rest unread.
    pub node_temperature_c: Vec<f64>,
    /// Integral of the PI law [K x 15 min].
    pub derating_integral_k: Vec<f64>,
    /// Whether the inverter was on at the end of the last plant step.
    pub inverter_on: Vec<bool>,
    /// Ageing state of each lane; see [`starting_ageing`].
    pub ageing: Vec<AgeingState>,
    /// Cooling state; None for a plant without cooling system, or at the start.
    pub cooling: Option<CoolingState>,
}

impl PlantState {
    /// Node temperatures for each lane.
    pub(crate) fn nodes(&self) -> usize {
        self.node_temperature_c.len() / self.soc.len().max(1)
    }

    /// Mean temperature of each lane [degC], of a state as [`Plant::state`] gives it: nodes that a string does not have are NaN.
    pub fn mean_temperature_c(&self) -> Vec<f64> {
        let mean = |own: &[f64]| {
            let real = own.iter().take_while(|t| !t.is_nan()).count();
            sum(&own[..real]) / real as f64
        };
        self.node_temperature_c.chunks_exact(self.nodes().max(1)).map(mean).collect()
    }
}

/// Sum in NumPy's order of additions for up to 128 numbers, so that decisions here and in Python agree to the last bit.
fn sum(values: &[f64]) -> f64 {
    let rows = values.chunks_exact(8);
    let rest = rows.remainder();
    let mut lanes = [0.0; 8];
    for row in rows {
        lanes.iter_mut().zip(row).for_each(|(lane, value)| *lane += value);
    }
    let [a, b, c, d, e, f, g, h] = lanes;
    rest.iter().fold(((a + b) + (c + d)) + ((e + f) + (g + h)), |sum, value| sum + value)
}

/// Ageing of lanes that start with these factors on capacity and resistance, one of each for each lane.
///
/// # Errors
///
/// Where the factors are not one of each for each lane, one is outside its range, or a string names a model of ageing
/// that does not exist.
pub fn starting_ageing(
    system: &System,
    soh_capacity: &[f64],
    soh_resistance: &[f64],
) -> Result<Vec<AgeingState>, InputError> {
    check_all("soh_resistance", soh_resistance, soh_capacity.len())?;
    let mut out = Vec::with_capacity(soh_capacity.len());
    for (lane, (&capacity, &resistance)) in soh_capacity.iter().zip(soh_resistance).enumerate() {
        let string = lane % system.strings.len();
        let place = || format!("string {string}: ");
        check_range("soh_capacity", capacity, "", SOH_CAPACITY, place)?;
        check_range("soh_resistance", resistance, "", SOH_RESISTANCE, place)?;
        out.push(StringAgeing::new(&system.strings[string])?.starting(capacity, resistance));
    }
    Ok(out)
}

impl Plant {
    /// The whole state.
    pub fn state(&self) -> PlantState {
        let lanes = self.lanes();
        let mut out = PlantState {
            soc: vec![0.0; lanes],
            node_temperature_c: vec![f64::NAN; lanes * self.max_nodes()],
            derating_integral_k: vec![0.0; lanes],
            inverter_on: vec![false; lanes],
            ageing: vec![AgeingState::default(); lanes],
            cooling: self.cooling_system.as_ref().map(|cooling_system| cooling_system.state.clone()),
        };
        self.blocks.iter().for_each(|block| block.write_state(&mut out));
        out
    }

    /// Replaces the state; nothing changes if it is refused. SOC beyond its window by rounding is put on the limit.
    ///
    /// # Errors
    ///
    /// Where an array has not one value for each lane (and node), or a value is outside its range.
    pub fn set_state(&mut self, state: &PlantState) -> Result<(), InputError> {
        self.check_lanes(state)?;
        let cooling = self.cooling_state(state)?;
        if let (Some(cooling_system), Some(cooling)) = (&mut self.cooling_system, cooling) {
            cooling_system.state = cooling;
        }
        self.blocks.iter_mut().for_each(|block| block.set_state(state));
        Ok(())
    }

    /// Initial state of the cooling: nothing runs, and the loop has the temperature of its strings.
    fn cooling_state(&self, state: &PlantState) -> Result<Option<CoolingState>, InputError> {
        let lanes = self.lanes();
        let Some(cooling_system) = &self.cooling_system else { return Ok(None) };
        let Some(cooling) = &state.cooling else {
            let strings = self.strings.len();
            let mean_c = |id: usize| {
                let own = self.own_nodes(state, id);
                own.iter().sum::<f64>() / own.len() as f64
            };
            let of_strings =
                |s: usize| (s * strings..(s + 1) * strings).map(mean_c).sum::<f64>() / strings as f64;
            return Ok(Some(CoolingState {
                stages: vec![0; lanes],
                chilling: vec![false; self.scenarios],
                loop_c: (0..self.scenarios).map(of_strings).collect(),
            }));
        };
        check_all("cooling stages", &cooling.stages, lanes)?;
        check_all("chilling", &cooling.chilling, self.scenarios)?;
        check_all("loop temperature", &cooling.loop_c, self.scenarios)?;
        for &stages in &cooling.stages {
            let most = cooling_system.max_stages() as f64;
            check_range("cooling stages", f64::from(stages), "", (0.0, most), String::new)?;
        }
        for &value in &cooling.loop_c {
            check_range("loop temperature", value, " degC", TEMPERATURE_C, String::new)?;
        }
        Ok(Some(cooling.clone()))
    }

    /// Temperatures of the nodes that a lane has.
    fn own_nodes<'s>(&self, state: &'s PlantState, id: usize) -> &'s [f64] {
        &state.node_temperature_c[id * state.nodes()..][..self.strings[id % self.strings.len()].spatial.nodes]
    }

    fn check_lanes(&self, state: &PlantState) -> Result<(), InputError> {
        let (lanes, nodes) = (self.lanes(), self.max_nodes());
        check_all("soc", &state.soc, lanes)?;
        check_all("node temperature", &state.node_temperature_c, lanes * nodes)?;
        check_all("derating integral", &state.derating_integral_k, lanes)?;
        check_all("inverter state", &state.inverter_on, lanes)?;
        check_all("ageing", &state.ageing, lanes)?;
        for id in 0..lanes {
            let string = id % self.strings.len();
            let parameters = &self.strings[string];
            let place = || format!("{}string {string}: ", self.scenario(id));
            let window = (parameters.soc_min, parameters.soc_max);
            let tolerant = (window.0 - ROUNDING, window.1 + ROUNDING);
            if !(tolerant.0..=tolerant.1).contains(&state.soc[id]) {
                check_range("soc", state.soc[id], "", window, place)?;
            }
            for &value in self.own_nodes(state, id) {
                check_range("node temperature", value, " degC", TEMPERATURE_C, place)?;
            }
            check_range("derating integral", state.derating_integral_k[id], " K", (0.0, f64::MAX), place)?;
            let loss = state.ageing[id].loss();
            check_range("soh_capacity", loss.soh_capacity, "", SOH_CAPACITY, place)?;
            check_range("soh_resistance", loss.soh_resistance, "", SOH_RESISTANCE, place)?;
        }
        Ok(())
    }
}
