//! Cold plates: a liquid cooled by a dry cooler, and by a chiller while the warmest string is too warm.

use bess_tables::Cooling;

use super::{conditioned, Kind, Source, Supply};

pub(super) static KIND: Kind = Kind { name: "hybrid", washes_ends: false, chills, supply };

fn chills(cooling: &Cooling, warmest_c: f64, chilling: bool) -> bool {
    let Some(start_c) = cooling.chill_c else { return false };
    warmest_c > if chilling { start_c - cooling.dead_band_k } else { start_c }
}

fn supply(cooling: &Cooling, ambient_c: f64, chilling: bool) -> Supply {
    let free_c = ambient_c + cooling.approach_k;
    let supply_c = cooling.supply_c.unwrap_or(free_c);
    if chilling {
        conditioned(cooling, supply_c, ambient_c)
    } else {
        Supply { temperature_c: supply_c.max(free_c), source: Source::Free }
    }
}
