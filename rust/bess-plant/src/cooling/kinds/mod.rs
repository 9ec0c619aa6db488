//! The kinds of cooling, one file each.

mod air;
mod hybrid;
mod liquid;

use bess_tables::Cooling;

/// All kinds. To add a kind, add a file here and a line below.
pub const KINDS: [&Kind; 3] = [&air::KIND, &liquid::KIND, &hybrid::KIND];

/// Heat sink of the coolant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// Open circuit: outdoor air.
    Ambient,
    /// Free cooling: the ambient through a heat exchanger, without the chiller.
    Free,
    Chiller,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Supply {
    pub(crate) temperature_c: f64,
    pub(crate) source: Source,
}

/// One kind of cooling: its heat sink and the conditions of its use.
#[derive(Debug)]
pub struct Kind {
    /// Name in system files.
    pub name: &'static str,
    /// Whether the coolant washes the end faces of a pack as well.
    pub(crate) washes_ends: bool,
    /// Whether the chiller may run, from the mean temperature of the warmest string and whether it might run before.
    pub(crate) chills: fn(&Cooling, f64, bool) -> bool,
    /// Temperature and source of the coolant at an ambient temperature.
    pub(crate) supply: fn(&Cooling, f64, bool) -> Supply,
}

/// Coolant at a controlled temperature: by free cooling if the ambient is cold enough, otherwise by a chiller.
pub(crate) fn conditioned(cooling: &Cooling, supply_c: f64, ambient_c: f64) -> Supply {
    let free = ambient_c + cooling.approach_k <= supply_c;
    Supply { temperature_c: supply_c, source: if free { Source::Free } else { Source::Chiller } }
}
