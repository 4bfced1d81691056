//! The circles that the code still has, each with all of its files. A circle leaves this list when it is gone.

pub const KNOWN_CIRCLES: &[&str] = &[
    "check, check::krl, check::text",
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
    "config::document, config::section",
    "cycle::boot, cycle::step",
    "cycle::execute, cycle::turn",
    "daemon, daemon::abrasion, daemon::acts, daemon::cameras, daemon::computing, daemon::contacts, \
     daemon::corners, daemon::corrected, daemon::gateway, daemon::lending, daemon::lending::client, \
     daemon::lending::serving, daemon::moves, daemon::ports, daemon::protocol, daemon::recording, \
     daemon::replay, daemon::replay::player, daemon::replay::queue, daemon::replay::taped, \
     daemon::replay::taping, daemon::request, daemon::request_handler, daemon::request_queue, \
     daemon::run, daemon::sight, daemon::single, daemon::single_interlocks, daemon::socket, \
     daemon::waiting, daemon::wiring, daemon::words",
    "eki::ack, eki::command, eki::state, eki::wire",
    "eki::channel, eki::channel::file",
    "eki::session, eki::session::flow",
    "krl::code, krl::condense",
    "krl::compile, krl::compile::flow, krl::compile::place",
    "krl::machine, krl::machine::calculate, krl::machine::interrupt, krl::machine::robot, \
     krl::machine::step",
    "path::contact, path::evenness, path::piece, path::plan",
    "path::kinematics, path::reach, path::reach::joint_motion, path::reach::margins, \
     path::reach::obstacles, path::reach::retract",
    "record, record::contact",
    "report::cycle, report::cycle::happened",
    "tape, tape::error, tape::read, tape::write",
];
