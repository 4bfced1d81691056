//! All integration tests: one binary, because each one links OpenCV.

mod boards;
mod calib;
mod camera_model;
mod commands;
mod config_files;
mod layers;
mod locate;
