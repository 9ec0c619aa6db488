//! The kinds of cooling, one file each.

mod air;
mod hybrid;
mod liquid;

use super::kind::Kind;

/// All kinds. A new one is a file here and a line below.
pub const KINDS: [&Kind; 3] = [&air::KIND, &liquid::KIND, &hybrid::KIND];
