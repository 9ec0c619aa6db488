use bess_tables::units::W_PER_KW;
use bess_tables::{StringParameters, System};

use crate::ageing::{AgeingState, StringAgeing};
use crate::block::{Block, Cooled, LaneState};
use crate::check::{check_all, check_range, TEMPERATURE_C};
use crate::cooling::{kind, with_coolant, Station};
use crate::record::Record;
use crate::thermal::Coefficients;
use crate::PlantError;

/// Values beyond a limit by no more than this share of it are rounding, not bad input.
const ROUNDING: f64 = 1e-9;

/// Plant steps that make sense [s].
const STEP_S: (f64, f64) = (1e-3, 86_400.0);

/// Longest control step [s]: a day, of which means still say something.
const CONTROL_STEP_S: f64 = 86_400.0;

/// Most plant steps of strings in one call: some minutes of work, a century of eight strings at 10 s.
const MOST_PLANT_STEPS: u128 = 10_000_000_000;

/// Factors on capacity and on resistance that a plant accepts.
const SOH_CAPACITY: (f64, f64) = (0.01, 1.5);
const SOH_RESISTANCE: (f64, f64) = (0.1, 100.0);

/// How the derating factor follows from temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeratingLaw {
    /// Table over mean temperature.
    #[default]
    Table,
    /// `k = clip(1 - Kp max(e, 0) - Ki I, 0, 1)`, `e = mean temperature - start`; `I <- max(0, I + e)` once per
    /// control step, scaled by its length over 15 min.
    Pi,
}

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
    /// What ageing has made of each lane; see [`starting_ageing`].
    pub ageing: Vec<AgeingState>,
    /// What cooling remembers; none for a plant without, or one that starts.
    pub cooling: Option<CoolingState>,
}

/// What the cooling of a plant remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct CoolingState {
    /// Stages of flow that are on, of each lane.
    pub stages: Vec<u8>,
    /// Whether the chiller of each scenario may run.
    pub chilling: Vec<bool>,
    /// Temperature of the common loop of each scenario [degC]; that of its strings where there is none.
    pub loop_c: Vec<f64>,
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
) -> Result<Vec<AgeingState>, PlantError> {
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

/// Requests and ambient of a run.
#[derive(Debug, Clone, Copy)]
pub struct Schedule<'a> {
    /// Control steps.
    pub(crate) steps: usize,
    /// Plant steps in each of them.
    pub(crate) substeps: usize,
    pub(crate) lanes: usize,
    pub(crate) strings: usize,
    pub(crate) request_w: &'a [f64],
    pub(crate) ambient_c: &'a [f64],
    /// Where reactive power is asked.
    pub(crate) reactive_var: Option<&'a [f64]>,
}

impl Schedule<'_> {
    #[inline]
    pub(crate) fn request_w(&self, step: usize, lane: usize) -> f64 {
        self.request_w[step * self.lanes + lane]
    }

    #[inline]
    pub(crate) fn reactive_var(&self, step: usize, lane: usize) -> f64 {
        self.reactive_var.map_or(0.0, |values| values[step * self.lanes + lane])
    }

    #[inline]
    pub(crate) fn ambient_c(&self, step: usize, lane: usize) -> f64 {
        self.ambient_c[step * (self.lanes / self.strings) + lane / self.strings]
    }
}

/// Strings, in one or more independent scenarios, that are stepped side by side.
///
/// Blocks of eight lanes, and one of four where four suffice. A lane's results depend on nothing but itself.
#[derive(Debug, Clone)]
pub struct Plant {
    strings: Vec<StringParameters>,
    scenarios: usize,
    step_s: f64,
    eights: Vec<Block<8>>,
    fours: Vec<Block<4>>,
    station: Option<Station>,
}

impl Plant {
    /// A plant in `state`, or an error if the plant step [s] is not stable for every string, or the state is not one.
    ///
    /// # Errors
    ///
    /// [`PlantError::Unstable`] with the largest stable step; [`PlantError::Range`] for a number of scenarios, nodes or a step
    /// that no plant has; as [`Self::set_state`] for the state.
    pub fn new(
        system: &System,
        scenarios: usize,
        step_s: f64,
        law: DeratingLaw,
        state: &PlantState,
    ) -> Result<Self, PlantError> {
        let mut strings = system.strings.clone();
        if let Some(cooling) = &system.cooling {
            let kind = kind(&cooling.kind)?;
            for string in &mut strings {
                string.spatial = with_coolant(cooling, kind, &string.spatial);
            }
        }
        check_range("plant step", step_s, " s", STEP_S, String::new)?;
        check_range("number of scenarios", scenarios as f64, "", (1.0, 1e6), String::new)?;
        for (string, parameters) in strings.iter().enumerate() {
            let place = || format!("string {string}: ");
            check_range("thermal nodes", parameters.spatial.nodes as f64, "", (1.0, 1e6), place)?;
            let number = Coefficients::new(&parameters.spatial, step_s).stability_number();
            if number > 1.0 {
                let nodes = parameters.spatial.nodes;
                // Rounded down, so that the step named in the message is accepted.
                let largest_s = (step_s / number * 1e4).floor() / 1e4;
                return Err(PlantError::Unstable { string, step_s, nodes, number, largest_s });
            }
        }
        let mut lanes: Vec<_> =
            (0..scenarios * strings.len()).map(|id| (id, &strings[id % strings.len()])).collect();
        lanes.sort_by_key(|(_, string)| string.spatial.nodes);
        let (mut eights, mut fours) = (Vec::new(), Vec::new());
        for equal in lanes.chunk_by(|a, b| a.1.spatial.nodes == b.1.spatial.nodes) {
            for members in equal.chunks(8) {
                if members.len() > 4 {
                    eights.push(Block::new(members, law, step_s)?);
                } else {
                    fours.push(Block::new(members, law, step_s)?);
                }
            }
        }
        let station = match &system.cooling {
            Some(cooling) => Some(Station::new(cooling, &strings, scenarios, step_s)?),
            None => None,
        };
        let mut plant = Self { strings, scenarios, step_s, eights, fours, station };
        plant.set_state(state)?;
        Ok(plant)
    }

    /// Strings times scenarios.
    pub fn lanes(&self) -> usize {
        self.scenarios * self.strings.len()
    }

    /// Most thermal nodes of any string.
    pub fn max_nodes(&self) -> usize {
        self.strings.iter().map(|s| s.spatial.nodes).max().unwrap_or(0)
    }

    /// Plant step [s].
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// The whole state.
    pub fn state(&self) -> PlantState {
        let (lanes, nodes) = (self.lanes(), self.max_nodes());
        let mut state = PlantState {
            soc: vec![0.0; lanes],
            node_temperature_c: vec![f64::NAN; lanes * nodes],
            derating_integral_k: vec![0.0; lanes],
            inverter_on: vec![false; lanes],
            ageing: Vec::with_capacity(lanes),
            cooling: self.station.as_ref().map(|station| CoolingState {
                stages: station.stages.clone(),
                chilling: station.chilling.clone(),
                loop_c: station.loop_c.clone(),
            }),
        };
        let mut ageing: Vec<_> = (0..lanes).map(|_| None).collect();
        let eights = self.eights.iter().flat_map(|block| each_lane(block.ids(), |l| block.state(l)));
        let fours = self.fours.iter().flat_map(|block| each_lane(block.ids(), |l| block.state(l)));
        for (id, lane) in eights.chain(fours) {
            state.soc[id] = lane.soc;
            let own = lane.node_temperature_c.len();
            state.node_temperature_c[id * nodes..id * nodes + own].copy_from_slice(&lane.node_temperature_c);
            state.derating_integral_k[id] = lane.integral_k;
            state.inverter_on[id] = lane.inverter_on;
            ageing[id] = Some(lane.ageing);
        }
        state.ageing.extend(ageing.into_iter().flatten());
        state
    }

    /// Replaces the state; nothing changes if it is refused. SOC beyond its window by rounding is put on the limit.
    ///
    /// # Errors
    ///
    /// Where an array has not one value for each lane (and node), or a value is outside its range.
    pub fn set_state(&mut self, state: &PlantState) -> Result<(), PlantError> {
        let lanes = self.lane_states(state)?;
        let cooling = self.cooling_state(state, &lanes)?;
        if let (Some(station), Some(cooling)) = (&mut self.station, cooling) {
            (station.stages, station.chilling, station.loop_c) =
                (cooling.stages, cooling.chilling, cooling.loop_c);
        }
        for block in &mut self.eights {
            let own: Vec<_> = block.ids().iter().map(|&id| &lanes[id]).collect();
            block.set_state(&own);
        }
        for block in &mut self.fours {
            let own: Vec<_> = block.ids().iter().map(|&id| &lanes[id]).collect();
            block.set_state(&own);
        }
        Ok(())
    }

    /// Advances by `request_w.len() / lanes` control steps of `duration_s`.
    ///
    /// `request_w[step * lanes + lane]` [W] is positive in discharge; `ambient_c[step * scenarios + scenario]`
    /// [degC] is the air inlet temperature. Nothing changes if the input is refused.
    ///
    /// # Errors
    ///
    /// Where arrays do not fit the lanes and scenarios, a request is above the nominal power of its string, a temperature is
    /// outside its range, or the duration is no multiple of the plant step.
    pub fn run(
        &mut self,
        request_w: &[f64],
        ambient_c: &[f64],
        duration_s: f64,
        keep_nodes: bool,
    ) -> Result<Record, PlantError> {
        self.run_with_reactive(request_w, None, ambient_c, duration_s, keep_nodes)
    }

    /// Like [`Self::run`], with reactive power beside each request, in their order [var]; its sign is kept. It gets what
    /// active power leaves of the apparent power of its inverter, which is the nominal power; the rest is not carried.
    ///
    /// # Errors
    ///
    /// As [`Self::run`], and where a reactive power is above the nominal power of its string.
    pub fn run_with_reactive(
        &mut self,
        request_w: &[f64],
        reactive_var: Option<&[f64]>,
        ambient_c: &[f64],
        duration_s: f64,
        keep_nodes: bool,
    ) -> Result<Record, PlantError> {
        let lanes = self.lanes();
        let steps = request_w.len() / lanes;
        check_all("request", request_w, steps * lanes)?;
        check_all("ambient temperature", ambient_c, steps * self.scenarios)?;
        self.check_powers("requested power", request_w, " kW")?;
        if let Some(reactive_var) = reactive_var {
            check_all("reactive power", reactive_var, steps * lanes)?;
            self.check_powers("reactive power", reactive_var, " kvar")?;
        }
        for (at, &value) in ambient_c.iter().enumerate() {
            let place = || format!("step {}: ", at / self.scenarios);
            check_range("ambient temperature", value, " degC", TEMPERATURE_C, place)?;
        }
        let substeps = self.substeps(duration_s)?;
        let count = steps as u128 * substeps as u128 * lanes as u128;
        if count > MOST_PLANT_STEPS {
            return Err(PlantError::TooMany { count, most: MOST_PLANT_STEPS, step_s: self.step_s });
        }
        let schedule = Schedule {
            steps,
            substeps,
            lanes,
            strings: self.strings.len(),
            request_w,
            ambient_c,
            reactive_var,
        };
        let mut record =
            Record::new(steps, (self.scenarios, lanes), self.max_nodes(), keep_nodes, reactive_var.is_some());
        if let Some(station) = &mut self.station {
            let eights = self.eights.iter_mut().map(|block| block as &mut dyn Cooled);
            let fours = self.fours.iter_mut().map(|block| block as &mut dyn Cooled);
            let mut blocks: Vec<_> = eights.chain(fours).collect();
            station.run(&mut blocks, &schedule, &mut record);
        } else {
            self.eights.iter_mut().for_each(|block| block.run(&schedule, &mut record));
            self.fours.iter_mut().for_each(|block| block.run(&schedule, &mut record));
        }
        Ok(record)
    }

    /// Powers of all lanes, step after step, are within the nominal powers of their strings.
    fn check_powers(
        &self,
        name: &'static str,
        power_w: &[f64],
        unit: &'static str,
    ) -> Result<(), PlantError> {
        let lanes = self.lanes();
        for (at, &value) in power_w.iter().enumerate() {
            let (step, string) = (at / lanes, at % lanes % self.strings.len());
            let nominal_w = self.strings[string].inverter.nominal_w;
            let limit = nominal_w * (1.0 + ROUNDING);
            if !(-limit..=limit).contains(&value) {
                return Err(PlantError::Range {
                    place: format!("{}step {step}, string {string}: ", self.scenario(at % lanes)),
                    name,
                    value: value / W_PER_KW,
                    unit,
                    low: -nominal_w / W_PER_KW,
                    high: nominal_w / W_PER_KW,
                });
            }
        }
        Ok(())
    }

    /// Whether the plant has cooling of its own.
    pub fn is_cooled(&self) -> bool {
        self.station.is_some()
    }

    /// Text that names the scenario of a lane, where there are several.
    fn scenario(&self, lane: usize) -> String {
        if self.scenarios == 1 {
            return String::new();
        }
        format!("scenario {}, ", lane / self.strings.len())
    }

    fn substeps(&self, duration_s: f64) -> Result<usize, PlantError> {
        let (ratio, step_s) = (duration_s / self.step_s, self.step_s);
        check_range("control step", duration_s, " s", (step_s, CONTROL_STEP_S), String::new)?;
        let whole = ratio.round();
        if (ratio - whole).abs() <= ROUNDING * whole {
            Ok(whole as usize)
        } else {
            Err(PlantError::Division { step_s, duration_s })
        }
    }

    /// What cooling remembers; of a plant that starts, nothing runs and the loop is as warm as its strings.
    fn cooling_state(
        &self,
        state: &PlantState,
        lanes: &[LaneState],
    ) -> Result<Option<CoolingState>, PlantError> {
        if self.station.is_none() {
            return Ok(None);
        }
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
            let most = self.station.as_ref().map_or(0, Station::most_stages);
            check_range("cooling stages", f64::from(stages), "", (0.0, most as f64), String::new)?;
        }
        for &value in &cooling.loop_c {
            check_range("loop temperature", value, " degC", TEMPERATURE_C, String::new)?;
        }
        Ok(Some(cooling.clone()))
    }

    fn lane_states(&self, state: &PlantState) -> Result<Vec<LaneState>, PlantError> {
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

fn each_lane<'a>(
    ids: &'a [usize],
    state: impl Fn(usize) -> LaneState + 'a,
) -> impl Iterator<Item = (usize, LaneState)> + 'a {
    ids.iter().enumerate().map(move |(lane, &id)| (id, state(lane)))
}
