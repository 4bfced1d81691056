//! Verdicts, their reasons and the checks that they come from: what a gate reports, in words a person can act on.

mod check;
mod judgement;

pub use check::{Check, Limit, LimitSource, SINCE_CHECKS, Severity};
pub use judgement::{Judgement, Reason, Verdict};
