//! The state after a restart of the program, from the state of the cycle at the end of the last process.

use super::{At, Cause, Job, State};

/// No motion continues. An open motion, tool or water that was on, or an abort that was not cleared leads to
/// Aborted; everything else leads to Stopped.
pub(super) fn state_after_restart(before: State) -> State {
    let at = match (before.intent, before.at) {
        // A restart is not an acknowledgement: what a person has not cleared stays to be cleared.
        (_, At::Aborting { cause, .. } | At::Aborted { cause } | At::Clearing { cause }) => At::Aborted { cause },
        // The arm was in motion, perhaps in contact, when the process ended, and nothing has reported its standstill.
        (Some(_), _) => At::Aborted { cause: Cause::Interrupted },
        (None, _) if before.facts.tool_may_run || before.facts.water_may_run => {
            At::Aborted { cause: Cause::OutputsOn }
        }
        (None, _) => At::Stopped,
    };
    // The outputs were not watched while no process ran; only suspicions survive.
    let facts = before.facts.facts_after_loss();
    State { at, facts, due: None, job: Job { running: false, ..before.job }, ..before }
}
