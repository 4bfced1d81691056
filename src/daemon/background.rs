//! Threads that stand back: page and plant take nothing from the loop and the robot's link.

/// How far they step back.
const NICE: i32 = 5;

/// The calling thread steps back behind the loop and the robot's link.
pub(super) fn step_back() {
    #[expect(
        clippy::let_underscore_must_use,
        reason = "where it is not permitted, the system shares out as it does"
    )]
    let _ = rustix::process::setpriority_process(None, NICE);
}
