//! The circles that the code still has, each with all of its files. A circle leaves this list when it is gone.

pub const KNOWN_CIRCLES: &[&str] = &[
    "check, check::krl, check::text",
    "check::eki, check::eki::channel, check::eki::clash, check::eki::say, check::eki::schema, \
     check::eki::traps",
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
    "daemon, daemon::abrasion, daemon::acts, daemon::asking, daemon::cameras, daemon::computing, \
     daemon::contacts, daemon::corners, daemon::corrected, daemon::desk, daemon::figures, \
     daemon::findings, daemon::lending, daemon::lending::client, daemon::lending::serving, \
     daemon::letters, daemon::moves, daemon::ports, daemon::protocol, daemon::reaching, \
     daemon::recording, daemon::replay, daemon::replay::player, daemon::replay::queue, \
     daemon::replay::taped, daemon::replay::taping, daemon::run, daemon::sight, daemon::single, \
     daemon::single_interlocks, daemon::socket, daemon::waiting, daemon::wiring, daemon::words",
    "devices::cameras, devices::cameras::bayer, devices::cameras::gige, devices::cameras::recorded, \
     devices::cameras::simulated, devices::world, devices::world::follow",
    "devices::gige, devices::gige::camera, devices::gige::link",
    "devices::mock::answer, devices::mock::channels, devices::mock::fault, devices::mock::fault::inject, \
     devices::mock::fault::spec, devices::mock::interpreted, devices::mock::interpreted::around, \
     devices::mock::interpreted::ethernet, devices::mock::interpreted::lock_step, \
     devices::mock::interpreted::schedule, devices::mock::interpreted::states, \
     devices::mock::interpreted::values, devices::mock::model, devices::mock::safety, \
     devices::mock::setup, devices::mock::submit",
    "devices::mock::legs, devices::mock::mover",
    "devices::robot, devices::robot::blocking, devices::robot::connect, devices::robot::run",
    "devices::zivid::host, devices::zivid::host::asking, devices::zivid::host::losing",
    "eki::ack, eki::command, eki::state, eki::wire",
    "eki::session, eki::session::flow",
    "krl::code, krl::condense",
    "krl::compile, krl::compile::flow, krl::compile::place",
    "krl::machine, krl::machine::calculate, krl::machine::interrupt, krl::machine::robot, \
     krl::machine::step",
    "path::contact, path::evenness, path::piece, path::plan",
    "path::kinematics, path::reach, path::reach::margins, path::reach::retract, path::reach::swing, \
     path::reach::things",
    "record, record::contact",
    "report::cycle, report::cycle::happened",
    "store, store::blobs, store::checkpoints, store::commit, store::contacts, store::copy, store::cycles, \
     store::discs, store::incidents, store::journal, store::motions, store::opening, store::prune, \
     store::requests, store::reserve, store::schema, store::teaching, store::verifications, store::verify",
    "tape, tape::error, tape::read, tape::write",
];
