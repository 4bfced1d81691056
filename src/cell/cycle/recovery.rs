//! Recovery at program start: folds the journal of the last process into a state, however that process ended.

use super::{Event, Report, State, step};

/// Returns the state to which a journal leads: the steps of the table are computed, but their effects are not
/// performed.
pub fn fold_journal(journal: impl IntoIterator<Item = Event>) -> State {
    journal.into_iter().fold(State::INITIAL, |state, event| step(state, event).0)
}

/// Returns the state in which a program starts with this journal in its store: Aborted, or Stopped.
///
/// It is the same as one step of [`Report::Boot`], which the loop journals before anything else, so that a journal of
/// many starts folds as one.
pub fn recover(journal: impl IntoIterator<Item = Event>) -> State {
    step(fold_journal(journal), Event::Reported(Report::Boot)).0
}
