//! `CLOCK_MONOTONIC` in nanoseconds: the clock that daemon and worker share.

use rustix::time::{ClockId, clock_gettime};

/// Returns the present time, ns.
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    // Neither number is negative on a clock that begins when the machine starts.
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}
