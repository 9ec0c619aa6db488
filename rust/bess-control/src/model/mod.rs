//! The control model: what a string does in an interval (docs/equations.md, 1 to 6), and what follows for a plant.
//!
//! `string` is one string over one interval, with the coefficients of its start, on the curves of `loss_curve`; `midpoint`
//! is its form in plans. `control_model` is a plant of them: roll-outs of given requests (`rollout`) and of a demand on the
//! whole plant (`follow`). `horizon` is a split problem on it, `objectives` what its schedules cost, `fitted` makes any
//! schedule one of it, `set_points` leaves out requests below the least power. `ranges` says which coefficients, `heat` which heat, a box of states can bring.

mod control_model;
mod fitted;
mod follow;
mod heat;
mod horizon;
mod loss_curve;
mod losses;
mod midpoint;
mod objectives;
mod ranges;
mod rollout;
mod set_points;
mod string;

pub use control_model::ControlModel;
pub(crate) use control_model::TEMPERATURE_RANGE_C;
pub use follow::{BestShares, Followed};
pub(crate) use heat::{heat_share, heat_w};
pub use horizon::{ControlHorizon, SplitProblem, MAX_GROUPS};
pub(crate) use loss_curve::LossCurve;
pub use losses::Losses;
pub(crate) use objectives::add;
pub use objectives::{CostsOf, Objectives};
pub use ranges::{CoefficientRanges, Range, StateBox};
pub(crate) use ranges::{Corner, Piece};
pub use rollout::{CoefficientsFrom, Rollout};
pub use string::{Coefficients, Flow, Interval, StringModel, StringState};
