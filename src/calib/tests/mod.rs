//! Hand-eye calibration on synthetic corners with known truth.

mod hand_eye;
