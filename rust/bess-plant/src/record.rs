//! Results of each control step of a plant.

/// Bit set of the limits that were active within a control step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Limits(pub u8);

impl Limits {
    /// No active limit.
    pub const NONE: Self = Self(0);
    /// Temperature derating reduced the request.
    pub const DERATING: Self = Self(1);
    /// Upper SOC limit in charge.
    pub const SOC_FULL: Self = Self(2);
    /// Lower SOC limit in discharge (or in charge with less power than the inverter loss).
    pub const SOC_EMPTY: Self = Self(4);
    /// Maximum power transfer of the battery, `V^2 / 4R`.
    pub const ROOT: Self = Self(8);
    /// The voltage limit of the cells.
    pub const VOLTAGE: Self = Self(16);
    /// The minimum power of an inverter: a request below it leaves the inverter off.
    pub const MIN_POWER: Self = Self(32);

    /// Both sets together.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

macro_rules! record {
    ($($(#[$doc:meta])* $field:ident),* $(,)?) => {
        /// Flows of every control step, lane by lane: value `[step * lanes + lane]`. Power and loss are means over
        /// the step; positive power and current are discharge.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Record {
            $($(#[$doc])* pub $field: Vec<f64>,)*
            /// Power of cooling [W]: value `[step * scenarios + scenario]`; 0 where a plant has none.
            pub auxiliary_w: Vec<f64>,
            /// Temperature of the coolant as it reaches the first string, at the end of the step [degC], in that order; NaN
            /// where a plant has no cooling of its own.
            pub coolant_c: Vec<f64>,
            /// Limits that were active within the step.
            pub limits: Vec<Limits>,
            /// Node temperatures at the end of the step [degC], `nodes` values for each lane; empty if not requested.
            pub node_temperature_c: Vec<f64>,
            /// Lanes of the record.
            pub lanes: usize,
            /// Values kept for each lane in `node_temperature_c`.
            pub nodes: usize,
        }

        impl Record {
            pub(crate) fn new(
                steps: usize,
                (scenarios, lanes): (usize, usize),
                nodes: usize,
                keep_nodes: bool,
            ) -> Self {
                let size = steps * lanes;
                Self {
                    $($field: vec![0.0; size],)*
                    auxiliary_w: vec![0.0; steps * scenarios],
                    coolant_c: vec![f64::NAN; steps * scenarios],
                    limits: vec![Limits::NONE; size],
                    // Strings with fewer nodes than the longest leave the rest undefined.
                    node_temperature_c: vec![f64::NAN; if keep_nodes { size * nodes } else { 0 }],
                    lanes,
                    nodes,
                }
            }

            /// Flows of the lanes, `auxiliary_w` and `coolant_c`, by name.
            pub fn into_flows(self) -> Vec<(&'static str, Vec<f64>)> {
                let of_scenarios = [("auxiliary_w", self.auxiliary_w), ("coolant_c", self.coolant_c)];
                [$((stringify!($field), self.$field),)*].into_iter().chain(of_scenarios).collect()
            }

            /// Adds the steps of another record of the same lanes.
            pub fn append(&mut self, mut later: Self) {
                $(self.$field.append(&mut later.$field);)*
                self.auxiliary_w.append(&mut later.auxiliary_w);
                self.coolant_c.append(&mut later.coolant_c);
                self.limits.append(&mut later.limits);
                self.node_temperature_c.append(&mut later.node_temperature_c);
            }
        }
    };
}

record! {
    /// Delivered AC power [W].
    delivered_w,
    /// Reactive power [var], signed as its demand.
    reactive_var,
    /// Availability loss: undelivered after derating [W].
    availability_loss_w,
    /// Derating loss [W].
    derating_loss_w,
    /// Inverter loss, standby included [W].
    inverter_loss_w,
    /// Inverter loss drawn from the grid in addition to the delivered power, by an inverter that is off or
    /// has reactive power only [W].
    standby_w,
    /// Ohmic battery loss [W].
    battery_loss_w,
    /// Heat of reaction [W], `-I T dU/dT`: negative = cooling; 0 without an entropy table.
    reversible_heat_w,
    /// Heat removed by the coolant [W]; 0 for a plant without cooling system.
    cooling_w,
    /// Hysteresis loss [W]: current times half the difference of the open-circuit voltages of charge and discharge.
    hysteresis_loss_w,
    /// Power drawn from the stored chemical energy [W]: its decrease over the step.
    chemical_w,
    /// Power [W] of the difference between the open-circuit voltage in use (start of the plant step, present temperature) and the
    /// voltage that defines chemical energy (mean over the charge that flows, 25 degC).
    ocv_shift_w,
    /// String current [A].
    current_a,
    /// SOC at the end of the step.
    soc,
    /// Mean temperature at the end of the step [degC].
    temperature_c,
    /// Hottest node within the step [degC].
    node_max_c,
    /// Derating factor.
    derating_factor,
    /// Off-to-on transitions of the inverter.
    inverter_starts,
    /// Capacity relative to the nameplate, at the end of the step.
    soh_capacity,
    /// Resistance relative to the nameplate, at the end of the step.
    soh_resistance,
    /// Capacity loss by calendar ageing, relative to the nameplate, at the end of the step.
    calendar_loss,
    /// Capacity loss by cycle ageing, at the end of the step.
    cyclic_loss,
    /// Charge lost with capacity at the end of the step [Ah]: SOC times the capacity loss.
    aged_charge_ah,
    /// AC energy - (chemical change + heat + hysteresis + inverter loss) + OCV shift [J].
    ledger_residual_j,
}
