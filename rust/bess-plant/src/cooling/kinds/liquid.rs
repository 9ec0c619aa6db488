//! Cold plates: a liquid that a chiller holds at a temperature, or a dry cooler where it is cold outside.

use bess_tables::Cooling;

use super::{conditioned, Kind, Supply};

pub(super) static KIND: Kind = Kind { name: "liquid", washes_ends: false, chills: |_, _, _| true, supply };

fn supply(cooling: &Cooling, ambient_c: f64, _: bool) -> Supply {
    // Without a temperature to hold, the coolant is as warm as a dry cooler makes it.
    let supply_c = cooling.supply_c.unwrap_or(ambient_c + cooling.approach_k);
    conditioned(cooling, supply_c, ambient_c)
}
