//! All integration tests: one binary, because each one links OpenCV.

mod boards;
mod calib;
mod camera_model;
mod commands;
mod config_files;
mod doctor;
mod follow;
mod gauntlet;
mod health;
mod hostile;
mod inputs;
mod kuka_files;
mod layers;
mod link;
mod locate;
mod patterns;
mod quiet;
mod rehearsal;
mod replay;
mod robot;
mod service;
mod supervised;
mod walk;
mod wall;
mod words;
mod zivid;
