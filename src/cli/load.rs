//! Reads the inputs of the commands: the cell and its calibrations, recipes, shots, poses, and the taught data.

mod cell_files;
mod inputs;
mod taught;

pub use cell_files::{CellFiles, LoadedCalibration, NO_AXES, calibrated_serial, last_touch_check};
pub use inputs::{CornerShot, corner_shots, flange_file, located, located_mm, picture, recipe, scan};
pub use taught::{LoadedPanel, derive, taught, teaching_of};
