//! Forced air from the ambient or from a temperature-controlled room.

use bess_tables::Cooling;

use super::{conditioned, Kind, Source, Supply};

pub(super) static KIND: Kind = Kind { name: "air", washes_ends: true, chills: |_, _, _| true, supply };

fn supply(cooling: &Cooling, ambient_c: f64, _: bool) -> Supply {
    match cooling.supply_c {
        None => Supply { temperature_c: ambient_c, source: Source::Ambient },
        Some(supply_c) => conditioned(cooling, supply_c, ambient_c),
    }
}
