//! Reads the inputs of the commands: the cell and its calibrations, recipes, shots, poses, and the taught data.

mod cell_files;
mod inputs;
mod taught;

pub use cell_files::{Calibrated, CellFiles, NO_AXES, calibrated_serial, last_touch};
pub use inputs::{CornerShot, corner_shots, flange_file, located, located_mm, picture, recipe, scan};
pub use taught::{Taught, derive, taught, teaching_of};
