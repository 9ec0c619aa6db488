//! Cooling of a plant: coolant flow, coolant temperature and auxiliary power.
//!
//! Every string has a thermostat of its own over its mean temperature, which sets the share `s` of its full flow. The coolant
//! flows along the packs like the air (`thermal.rs`), so a string of uniform temperature gives off
//! `Q = m cp (1 - exp(-NTU)) (T_s - T_in)`. Fan or pump take `s^3 m dp / (rho eta)` (pressure rises with the square of
//! the flow), which heats the coolant. The heat goes to a source: the ambient, free cooling through a heat
//! exchanger, or a chiller with `COP = min(cop_max, share T_c / (T_h - T_c))`, `T_c` and `T_h` one approach below the
//! supply and above the ambient.
//!
//! A `Kind` defines the heat sink and its conditions, the `thermostat` the flow; the `CoolingSystem` steps both with the strings.
//!
//! Without a common loop every string is supplied at the supply temperature. With one, all strings share a fully mixed
//! coolant (a room, or pipes and a tank). It exchanges heat with the strings, through walls with the ambient, and with the source,
//! which keeps it at the supply temperature within its limit:
//! `C dT/dt = sum Q + P_mover + UA (T_ambient - T) - Q_source`, in explicit steps like the cells.

mod kinds;
mod system;
mod thermostat;

pub use kinds::{Kind, KINDS};
pub use system::CoolingState;
pub(crate) use system::CoolingSystem;

use bess_tables::units::ZERO_C_IN_K;
use bess_tables::{Cooling, InputError, SpatialThermal};

use crate::check::named;

pub(crate) fn kind(name: &str) -> Result<&'static Kind, InputError> {
    named("cooling kind", name, &KINDS.map(|kind| kind.name)).map(|at| KINDS[at])
}

/// The thermal model of a string with its coolant in place of its air.
pub(crate) fn with_coolant(cooling: &Cooling, kind: &Kind, air: &SpatialThermal) -> SpatialThermal {
    SpatialThermal {
        air_flow_kg_s: cooling.flow_kg_s.unwrap_or(air.air_flow_kg_s),
        air_cp_j_kgk: cooling.cp_j_kgk.unwrap_or(air.air_cp_j_kgk),
        lateral_u_w_m2k: cooling.u_w_m2k.unwrap_or(air.lateral_u_w_m2k),
        end_u_w_m2k: if kind.washes_ends { air.end_u_w_m2k } else { 0.0 },
        ..air.clone()
    }
}

/// Coefficient of performance of the chiller between a supply and an ambient temperature [degC].
pub(crate) fn cop(cooling: &Cooling, supply_c: f64, ambient_c: f64) -> f64 {
    let cold_k = supply_c - cooling.approach_k + ZERO_C_IN_K;
    let lift_k = ambient_c + cooling.approach_k + ZERO_C_IN_K - cold_k;
    if lift_k > 0.0 {
        cooling.cop_max.min(cooling.carnot_share * cold_k / lift_k)
    } else {
        cooling.cop_max
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::common;

    #[test]
    fn the_cop_of_a_chiller_is_its_share_of_carnot_up_to_the_maximum() {
        let cooling = common::cooling("liquid");
        // Evaporator at 20, condenser at 40 degC.
        assert!((cop(&cooling, 25.0, 35.0) - (0.4 * 293.15 / 20.0_f64).min(6.0)).abs() < 1e-12);
        assert!((cop(&cooling, 20.0, 45.0) - 0.4 * 288.15 / 35.0).abs() < 1e-12);
        assert_eq!(cop(&cooling, 25.0, 16.0), 6.0);
        assert_eq!(cop(&cooling, 25.0, 0.0), 6.0);
    }

    #[test]
    fn an_unknown_kind_is_refused_with_those_there_are() {
        let text = kind("ice").unwrap_err().to_string();
        assert_eq!(text, "cooling kind 'ice' is unknown; there are air, liquid, hybrid");
    }
}
