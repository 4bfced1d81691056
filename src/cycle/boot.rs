//! Start of the program: folds the journal of the last process into a state, however that process ended.

use super::{Event, Report, State, step};

/// The state that a journal leads to: the table's own steps, their effects left undone.
pub fn fold(journal: impl IntoIterator<Item = Event>) -> State {
    journal.into_iter().fold(State::NEW, |state, event| step(state, event).0)
}

/// The state in which a program starts with this journal in its store: Aborted, or Stopped.
///
/// It is the same as one step of [`Report::Boot`], which the loop journals before anything else, so that a journal
/// of many starts folds as one.
pub fn recover(journal: impl IntoIterator<Item = Event>) -> State {
    step(fold(journal), Event::Told(Report::Boot)).0
}
