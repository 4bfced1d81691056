//! Compares areas around breaks (`[treat] by = "break"`) with whole grids: the sanded surface, the time of the paths,
//! and the breaks that remain. Part `plans` plans over many films with grids of three sizes; part `cycles` runs whole
//! cycles on the simulated cell. `cargo bench --bench treat -- plans cycles seeds=60 from=1 reduction=4 minutes=15`;
//! without a part, both. With `minutes` no new cycle begins after this time. Exit code 1 if a target is missed.

#[path = "arguments.rs"]
mod arguments;
#[path = "treat/cycles.rs"]
mod cycles;
#[path = "goal.rs"]
mod goal;
#[path = "treat/plans.rs"]
mod plans;

use std::process::ExitCode;

fn main() -> ExitCode {
    let is_named = |part: &str| std::env::args().any(|argument| argument == part);
    let is_all = !is_named("plans") && !is_named("cycles");
    let seeds = arguments::number("seeds").unwrap_or(60);
    let reduction = arguments::number("reduction").unwrap_or(4);
    let is_planned = !(is_all || is_named("plans")) || plans::measure(seeds, reduction);
    let is_run = !(is_all || is_named("cycles")) || cycles::measure(seeds, reduction);
    if is_planned && is_run { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
