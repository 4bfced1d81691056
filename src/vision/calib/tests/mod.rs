//! Tests of calibrations against known true values: synthetic corners for statistics, rendered boards for detection.

mod boards;
mod hand_eye;
mod lenses;
mod robot;
mod subsets;
mod wrong_inputs;
