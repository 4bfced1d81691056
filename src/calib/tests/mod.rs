//! Calibrations against known truth: synthetic corners for statistics, rendered boards for detection.

mod boards;
mod hand_eye;
mod three_points;
