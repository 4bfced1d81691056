//! The circles that the code still has, each with all of its files. A circle leaves this list when it is gone.

pub const KNOWN_CIRCLES: &[&str] = &[
    "cli::args, cli::calibrate::args",
    "cli::calibrate, cli::calibrate::hand_eye, cli::calibrate::in_use, cli::calibrate::intrinsics, \
     cli::calibrate::live, cli::calibrate::live::looking, cli::calibrate::live::moving, \
     cli::calibrate::live::touching, cli::calibrate::over_volume, cli::calibrate::robot, \
     cli::calibrate::target, cli::calibrate::taught_corner, cli::calibrate::tcp, \
     cli::calibrate::three_points, cli::calibrate::verify",
    "cli::ctl, cli::follow",
    "cli::doctor, cli::doctor::cell, cli::doctor::devices, cli::doctor::judge, cli::doctor::machine, \
     cli::doctor::zivid",
    "cli::inspect, cli::validate",
    "cli::new, cli::new::cell, cli::new::recipe",
    "cli::prove, cli::prove::page, cli::prove::tries",
    "cli::render, cli::render_boards",
    "cli::shoot, cli::shoot::film",
    "daemon, daemon::abrasion, daemon::acts, daemon::cameras, daemon::computing, \
     daemon::computing::memory, daemon::computing::worker, daemon::contacts, daemon::corners, daemon::corrected, daemon::gateway, \
     daemon::lending, daemon::lending::client, daemon::lending::serving, daemon::moves, daemon::ports, \
     daemon::ports::cameras, daemon::ports::record, daemon::ports::requests, daemon::ports::robot, \
     daemon::protocol, daemon::recording, daemon::replay::form, daemon::replay::form::cameras, \
     daemon::replay::player, daemon::replay::queue, daemon::replay::recorded_port, \
     daemon::replay::switch, daemon::request, daemon::request_handler, daemon::request_queue, \
     daemon::run, daemon::sight, daemon::single, daemon::single_interlocks, daemon::socket, \
     daemon::wiring, daemon::without_store, daemon::words",
];
