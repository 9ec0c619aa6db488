//! The state of a plant: set, get and checks.

use bess_tables::{InputError, System};

use super::{Plant, ROUNDING};
use crate::ageing::{AgeingState, StringAgeing};
use crate::block::LaneState;
use crate::check::{check_all, check_range, TEMPERATURE_C};
use crate::cooling::CoolingState;

/// Factors on capacity and on resistance that a plant accepts.
const SOH_CAPACITY: (f64, f64) = (0.01, 1.5);
const SOH_RESISTANCE: (f64, f64) = (0.1, 100.0);

/// State of a plant, complete: a plant that is given it continues bit by bit.
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
    /// Mean temperature of each lane [degC], of a state as [`Plant::state`] gives it: nodes that a string does not have are
    /// NaN.
    pub fn mean_temperature_c(&self) -> Vec<f64> {
        let nodes = self.node_temperature_c.len() / self.soc.len().max(1);
        let mean = |own: &[f64]| {
            let real = own.iter().take_while(|t| !t.is_nan()).count();
            sum(&own[..real]) / real as f64
        };
        self.node_temperature_c.chunks_exact(nodes.max(1)).map(mean).collect()
    }
}

/// Sum in the order of additions that NumPy takes for up to 128 numbers: a decision made here is that made from Python, to the
/// last bit.
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
        let mut lanes: Vec<(usize, LaneState)> =
            self.blocks.iter().flat_map(|block| block.states()).collect();
        lanes.sort_by_key(|(id, _)| *id);
        let nodes = self.max_nodes();
        let node_c = |(_, lane): &(usize, LaneState)| {
            let mut own = lane.node_temperature_c.clone();
            own.resize(nodes, f64::NAN);
            own
        };
        PlantState {
            soc: lanes.iter().map(|(_, lane)| lane.soc).collect(),
            node_temperature_c: lanes.iter().flat_map(node_c).collect(),
            derating_integral_k: lanes.iter().map(|(_, lane)| lane.integral_k).collect(),
            inverter_on: lanes.iter().map(|(_, lane)| lane.inverter_on).collect(),
            ageing: lanes.into_iter().map(|(_, lane)| lane.ageing).collect(),
            cooling: self.station.as_ref().map(|station| station.state.clone()),
        }
    }

    /// Replaces the state; nothing changes if it is refused. SOC beyond its window by rounding is put on the limit.
    ///
    /// # Errors
    ///
    /// Where an array has not one value for each lane (and node), or a value is outside its range.
    pub fn set_state(&mut self, state: &PlantState) -> Result<(), InputError> {
        let lanes = self.lane_states(state)?;
        let cooling = self.cooling_state(state, &lanes)?;
        if let (Some(station), Some(cooling)) = (&mut self.station, cooling) {
            station.state = cooling;
        }
        for block in &mut self.blocks {
            let own: Vec<_> = block.ids().iter().map(|&id| &lanes[id]).collect();
            block.set_state(&own);
        }
        Ok(())
    }

    /// Initial state of the cooling: nothing runs, and the loop has the temperature of its strings.
    fn cooling_state(
        &self,
        state: &PlantState,
        lanes: &[LaneState],
    ) -> Result<Option<CoolingState>, InputError> {
        let Some(station) = &self.station else { return Ok(None) };
        let Some(cooling) = &state.cooling else {
            let mean_c = |lane: &LaneState| {
                lane.node_temperature_c.iter().sum::<f64>() / lane.node_temperature_c.len() as f64
            };
            let of_strings = |own: &[LaneState]| own.iter().map(mean_c).sum::<f64>() / own.len() as f64;
            return Ok(Some(CoolingState {
                stages: vec![0; lanes.len()],
                chilling: vec![false; self.scenarios],
                loop_c: lanes.chunks(self.strings.len()).map(of_strings).collect(),
            }));
        };
        check_all("cooling stages", &cooling.stages, lanes.len())?;
        check_all("chilling", &cooling.chilling, self.scenarios)?;
        check_all("loop temperature", &cooling.loop_c, self.scenarios)?;
        for &stages in &cooling.stages {
            let most = station.most_stages() as f64;
            check_range("cooling stages", f64::from(stages), "", (0.0, most), String::new)?;
        }
        for &value in &cooling.loop_c {
            check_range("loop temperature", value, " degC", TEMPERATURE_C, String::new)?;
        }
        Ok(Some(cooling.clone()))
    }

    /// States of all lanes, checked.
    fn lane_states(&self, state: &PlantState) -> Result<Vec<LaneState>, InputError> {
        let (lanes, nodes) = (self.lanes(), self.max_nodes());
        check_all("soc", &state.soc, lanes)?;
        check_all("node temperature", &state.node_temperature_c, lanes * nodes)?;
        check_all("derating integral", &state.derating_integral_k, lanes)?;
        check_all("inverter state", &state.inverter_on, lanes)?;
        check_all("ageing", &state.ageing, lanes)?;
        let mut out = Vec::with_capacity(lanes);
        for id in 0..lanes {
            let string = id % self.strings.len();
            let parameters = &self.strings[string];
            let place = || format!("{}string {string}: ", self.scenario(id));
            let window = (parameters.soc_min, parameters.soc_max);
            let tolerant = (window.0 - ROUNDING, window.1 + ROUNDING);
            if !(tolerant.0..=tolerant.1).contains(&state.soc[id]) {
                check_range("soc", state.soc[id], "", window, place)?;
            }
            let first = id * nodes;
            let own = &state.node_temperature_c[first..first + parameters.spatial.nodes];
            for &value in own {
                check_range("node temperature", value, " degC", TEMPERATURE_C, place)?;
            }
            let integral_k = state.derating_integral_k[id];
            check_range("derating integral", integral_k, " K", (0.0, f64::MAX), place)?;
            let loss = state.ageing[id].loss();
            check_range("soh_capacity", loss.soh_capacity, "", SOH_CAPACITY, place)?;
            check_range("soh_resistance", loss.soh_resistance, "", SOH_RESISTANCE, place)?;
            out.push(LaneState {
                soc: state.soc[id].clamp(window.0, window.1),
                node_temperature_c: own.to_vec(),
                integral_k,
                inverter_on: state.inverter_on[id],
                ageing: state.ageing[id].clone(),
            });
        }
        Ok(out)
    }
}
