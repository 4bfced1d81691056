//! The state after a restart of the program, from the state of the cycle at the end of the last process.

use super::{At, Cause, Job, State};

/// No motion continues. An open motion, tool or water that was on, or an abort that was not cleared leads to
/// Aborted; everything else leads to Stopped.
pub(super) fn state_after_restart(before: State) -> State {
    let at = match (before.intent, before.at) {
        (_, At::Aborting { cause, .. } | At::Aborted { cause } | At::Clearing { cause }) => At::Aborted { cause },
        (Some(_), _) => At::Aborted { cause: Cause::Interrupted },
        (None, _) if before.facts.tool_may_run || before.facts.water_may_run => {
            At::Aborted { cause: Cause::OutputsOn }
        }
        (None, _) => At::Stopped,
    };
    let facts = before.facts.lasting();
    State { at, facts, due: None, job: Job { running: false, ..before.job }, ..before }
}
