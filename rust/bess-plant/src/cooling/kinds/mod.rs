//! The kinds of cooling, one file each.

mod air;
mod hybrid;
mod liquid;

use bess_tables::Cooling;

/// All kinds. A new one is a file here and a line below.
pub const KINDS: [&Kind; 3] = [&air::KIND, &liquid::KIND, &hybrid::KIND];

/// Heat sink of the coolant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// Nothing: the coolant comes from outside and goes there.
    Ambient,
    /// The ambient through a heat exchanger, past the chiller.
    Free,
    Chiller,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Supply {
    pub(crate) temperature_c: f64,
    pub(crate) source: Source,
}

/// One kind of cooling: where the coolant's heat goes, and when.
#[derive(Debug)]
pub struct Kind {
    /// Name in system files.
    pub name: &'static str,
    /// Whether the coolant washes the end faces of a pack as well.
    pub(crate) washes_ends: bool,
    /// Whether the chiller may run, from the mean temperature of the warmest string and whether it may already.
    pub(crate) chills: fn(&Cooling, f64, bool) -> bool,
    /// Temperature and source of the coolant at an ambient temperature.
    pub(crate) supply: fn(&Cooling, f64, bool) -> Supply,
}

/// Coolant that is held at a temperature: by the ambient where that is cold enough, else by a chiller.
pub(crate) fn conditioned(cooling: &Cooling, supply_c: f64, ambient_c: f64) -> Supply {
    let free = ambient_c + cooling.approach_k <= supply_c;
    Supply { temperature_c: supply_c, source: if free { Source::Free } else { Source::Chiller } }
}
