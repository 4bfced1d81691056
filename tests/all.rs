//! All integration tests in one binary, because each binary links OpenCV.

mod arm;
mod backup;
mod board_pictures;
mod boards;
mod calib;
mod camera_model;
mod commands;
mod complete;
mod config_files;
mod crates;
mod doctor;
mod figures;
#[path = "bench/table/rows.rs"]
mod figures_rows;
mod follow;
mod fuzz;
mod gauntlet;
mod glossary;
#[path = "bench/goal.rs"]
mod goal;
mod health;
mod hostile;
mod inputs;
mod krl;
mod kuka_files;
mod label_page;
mod layers;
mod licences;
mod line;
mod link;
mod live;
mod locate;
mod long;
mod manual;
mod new;
mod nominal;
#[cfg(feature = "plant")]
mod office;
#[cfg(feature = "plant")]
mod opcua;
mod operator_page;
mod patterns;
#[allow(dead_code, reason = "the bench uses the rest")]
#[cfg(feature = "plant")]
mod plant;
mod poor_pictures;
mod push;
mod quiet;
mod record;
mod records;
mod rehearsal;
mod replay;
mod robot;
mod scanner_errors;
mod service;
mod shoot;
#[cfg(feature = "plant")]
mod sparkplug;
mod supervised;
mod teach_page;
mod told;
mod tool_faults;
mod walk;
mod wall;
#[cfg(feature = "plant")]
mod without_plant;
mod words;
#[allow(dead_code, unused_imports, reason = "the bench uses the rest")]
mod world;
#[allow(dead_code, reason = "the bench uses the rest")]
#[path = "world/mutations/mod.rs"]
mod world_mutations;
#[path = "world/mutations/list.rs"]
mod world_mutations_list;
#[path = "world/short.rs"]
mod world_short;
mod zivid;
