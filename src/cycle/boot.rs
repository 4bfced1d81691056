//! After the end of a process, however it came: what its journal says, and where the next one rests.

use super::{At, Cause, Event, Job, Report, State, step};

/// The state that a journal leads to: the table's own steps, their effects left undone.
pub fn fold(journal: impl IntoIterator<Item = Event>) -> State {
    journal.into_iter().fold(State::NEW, |state, event| step(state, event).0)
}

/// Where a program starts whose store holds this journal: Aborted, or Stopped.
///
/// The same as one step of [`Report::Boot`], which the loop journals before anything else, so that a journal of many
/// starts folds as one.
pub fn recover(journal: impl IntoIterator<Item = Event>) -> State {
    step(fold(journal), Event::Told(Report::Boot)).0
}

/// Nothing that moves goes on. An open motion, tool or water that was on, or an abort that nobody cleared, is Aborted; all
/// else is Stopped.
pub(super) fn booted(before: State) -> State {
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
