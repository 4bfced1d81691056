//! Threads that stand back: page and plant take nothing from the loop and the robot's link, and where the code of a library fails on what a
//! network sends, the cell goes on.

use crate::supervision;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;
use tokio::time::timeout;

/// What panicked begins anew after this time.
const AGAIN: Duration = Duration::from_secs(1);

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

/// Runs this on the calling thread until it returns, which it does when it is told that it is to end. Where it panics, that is no fault of
/// the cell, and it begins anew.
pub(super) fn run_apart(
    runtime: &Runtime,
    what: &str,
    mut ended: oneshot::Receiver<()>,
    begin: impl AsyncFn(&mut oneshot::Receiver<()>),
) {
    supervision::stand_apart();
    step_back();
    while catch_unwind(AssertUnwindSafe(|| runtime.block_on(begin(&mut ended)))).is_err() {
        tracing::warn!("{what} failed, as the lines above say; it begins anew");
        if runtime.block_on(async { timeout(AGAIN, &mut ended).await }).is_ok() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use tokio::runtime::Builder;

    /// It panics twice, works on at its third begin, and ends when it is told to.
    #[test]
    fn what_panics_begins_anew_until_it_is_ended() {
        let (end, ended) = oneshot::channel();
        let runs = std::thread::spawn(move || {
            let (begun, end) = (Cell::new(0), Cell::new(Some(end)));
            let runtime = Builder::new_current_thread().enable_time().build().expect("a runtime");
            run_apart(&runtime, "a front", ended, async |ended| {
                begun.set(begun.get() + 1);
                assert!(begun.get() > 2, "it fails");
                drop(end.take());
                assert!(ended.await.is_err(), "it is told by dropping the other side");
            });
            begun.get()
        });
        assert_eq!(runs.join().expect("the panics were caught"), 3);
    }
}
