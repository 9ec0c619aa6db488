//! Claims about whole plants, with the helpers of all tests.

mod ageing;
pub(crate) mod common;
mod plant;
