//! Cold plates: a liquid cooled by a chiller, or by a dry cooler if the ambient is cold enough.

use bess_tables::Cooling;

use super::{conditioned, Kind, Supply};

pub(super) static KIND: Kind = Kind { name: "liquid", washes_ends: false, chills: |_, _, _| true, supply };

fn supply(cooling: &Cooling, ambient_c: f64, _: bool) -> Supply {
    // Without a supply temperature, only the dry cooler cools.
    let supply_c = cooling.supply_c.unwrap_or(ambient_c + cooling.approach_k);
    conditioned(cooling, supply_c, ambient_c)
}
