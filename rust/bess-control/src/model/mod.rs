//! The control model of strings over an interval (docs/equations.md, 1 to 6), and of a plant.
//!
//! `string` is one string over one interval, with the coefficients of its start, on the curves of `loss_curve`; `midpoint` is its
//! form in plans. `control_model` combines strings to a plant: roll-outs of given requests (`rollout`) and of a demand on the
//! whole plant (`track_demand`). `horizon` is a split problem, `objectives` the cost of schedules, `fitted` meets the demand
//! within the limits, `set_points` removes requests below the minimum power. `ranges` bounds the coefficients over a box of
//! states; `heat` is the heat of a power.

mod control_model;
mod fitted;
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
mod track_demand;

pub use control_model::ControlModel;
pub(crate) use control_model::TEMPERATURE_RANGE_C;
pub(crate) use heat::{heat_share, heat_w};
pub use horizon::{ControlHorizon, SplitProblem, MAX_GROUPS};
pub(crate) use loss_curve::LossCurve;
pub use losses::Losses;
pub(crate) use objectives::{total, BLOCK};
pub use objectives::{CostsOf, Objectives};
pub use ranges::{CoefficientRanges, Range, StateBox};
pub(crate) use ranges::{Corner, Piece};
pub use rollout::Rollout;
pub use string::{Coefficients, CoefficientsFrom, Flow, Interval, StringModel, StringState};
pub use track_demand::{BestShares, TrackedDemand};
