//! Interface of the plant: built from parameters and a state, advanced by requests.

mod requests;
mod state;

pub(crate) use requests::Schedule;
pub use state::{starting_ageing, PlantState};

use bess_tables::{InputError, StringParameters, System};

use crate::block::{Block, DeratingLaw};
use crate::check::check_range;
use crate::cooling::{kind, with_coolant, CoolingSystem};
use crate::lanes::WIDTH;
use crate::record::Record;
use crate::thermal::Coefficients;

/// Values beyond a limit by no more than this share of it are rounding, not bad input.
const ROUNDING: f64 = 1e-9;

const STEP_S: (f64, f64) = (1e-3, 86_400.0);

/// Strings in one or more independent scenarios, simulated in parallel.
///
/// The results of a lane do not depend on other lanes.
#[derive(Debug)]
pub struct Plant {
    strings: Vec<StringParameters>,
    scenarios: usize,
    step_s: f64,
    blocks: Vec<Block>,
    cooling_system: Option<CoolingSystem>,
}

impl Plant {
    /// A plant in `state` with plant steps of `step_s` [s].
    ///
    /// # Errors
    ///
    /// The plant step is unstable (the message names the largest stable one); the plant step, the number of scenarios or
    /// the number of nodes is out of range; or the state is invalid, see [`Self::set_state`].
    pub fn new(
        system: &System,
        scenarios: usize,
        step_s: f64,
        law: DeratingLaw,
        state: &PlantState,
    ) -> Result<Self, InputError> {
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
                return Err(InputError(format!(
                    "string {string}: a plant step of {step_s} s is unstable for {nodes} thermal nodes (2 Fo + lateral = \
                     {number:.4} > 1); use at most {largest_s:.4} s, or fewer nodes"
                )));
            }
        }
        let mut lanes: Vec<_> =
            (0..scenarios * strings.len()).map(|id| (id, &strings[id % strings.len()])).collect();
        lanes.sort_by_key(|(_, string)| string.spatial.nodes);
        let blocks = lanes
            .chunk_by(|a, b| a.1.spatial.nodes == b.1.spatial.nodes)
            .flat_map(|equal| equal.chunks(WIDTH))
            .map(|members| Block::new(members, law, step_s))
            .collect::<Result<_, _>>()?;
        let cooling_system = match &system.cooling {
            Some(cooling) => Some(CoolingSystem::new(cooling, &strings, scenarios, step_s)?),
            None => None,
        };
        let mut plant = Self { strings, scenarios, step_s, blocks, cooling_system };
        plant.set_state(state)?;
        Ok(plant)
    }

    /// Strings times scenarios.
    pub fn lanes(&self) -> usize {
        self.scenarios * self.strings.len()
    }

    /// Maximum number of thermal nodes of a string.
    fn max_nodes(&self) -> usize {
        self.strings.iter().map(|s| s.spatial.nodes).max().unwrap_or(0)
    }

    /// Advances by `request_w.len() / lanes` control steps of `duration_s`.
    ///
    /// `request_w[step * lanes + lane]` [W] is positive in discharge; `ambient_c[step * scenarios + scenario]` [degC] is the air
    /// inlet temperature. Reactive power, if any, is in the order of the requests [var]; its sign is kept. It is limited to the
    /// apparent power that active power leaves of the nominal power of its inverter. Nothing changes if the input is refused.
    ///
    /// # Errors
    ///
    /// Where arrays do not fit the lanes and scenarios, a request or a reactive power is above the nominal power of its
    /// string, a temperature is outside its range, or the duration is no multiple of the plant step.
    pub fn run(
        &mut self,
        request_w: &[f64],
        reactive_var: Option<&[f64]>,
        ambient_c: &[f64],
        duration_s: f64,
        keep_nodes: bool,
    ) -> Result<Record, InputError> {
        let schedule = self.schedule(request_w, reactive_var, ambient_c, duration_s)?;
        let shape = (self.scenarios, schedule.lanes);
        let mut record = Record::new(schedule.steps, shape, self.max_nodes(), keep_nodes);
        match &mut self.cooling_system {
            Some(cooling_system) => cooling_system.run(&mut self.blocks, &schedule, &mut record),
            None => self.blocks.iter_mut().for_each(|block| block.run(&schedule, &mut record)),
        }
        Ok(record)
    }

    /// Text that names the scenario of a lane, where there are several.
    fn scenario(&self, lane: usize) -> String {
        if self.scenarios == 1 {
            return String::new();
        }
        format!("scenario {}, ", lane / self.strings.len())
    }
}
