//! The control model: a string, a horizon of strings, roll-outs, and what coefficients a box of states can have.

mod control_model;
mod fitted;
mod follow;
mod heat;
mod horizon;
mod loss;
mod losses;
mod ranges;
mod rollout;
mod string;

pub use control_model::ControlModel;
pub use follow::{BestShares, Followed};
pub(crate) use heat::{heat_share, heat_w};
pub(crate) use horizon::add;
pub use horizon::{ControlHorizon, Costs, CostsOf, Problem, MAX_GROUPS};
pub(crate) use loss::LossCurve;
pub use losses::Losses;
pub use ranges::{CoefficientRanges, Range, StateBox};
pub(crate) use ranges::{Corner, Piece};
pub use rollout::{CoefficientsFrom, Rollouts};
pub use string::{Coefficients, Flow, Interval, StringModel, StringState};
