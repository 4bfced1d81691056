//! All integration tests: one binary, because each one links OpenCV.

mod camera_model;
mod commands;
mod layers;
mod locate;
