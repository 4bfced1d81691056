//! Detects two cells that use one name: their stores have different epochs and report these in turn.

use panelprep_store::office::CellState;
use std::collections::BTreeMap;

/// The cells' last reports, by the cells' names.
#[derive(Debug, Default)]
pub(super) struct Names(BTreeMap<String, ReportedEpochs>);

#[derive(Debug, Default)]
struct ReportedEpochs {
    /// The epochs that were reported last, and the different ones before them.
    last: Vec<String>,
    previous_epochs: Vec<String>,
    is_reported: bool,
}

impl Names {
    /// Returns true when it is detected for the first time that two cells use this name: the reported epochs changed
    /// and then changed back to the previous ones. A change of epochs without a change back may be a restored store.
    pub fn detect_duplicate_name(&mut self, cell: &str, state: &CellState) -> bool {
        let mut epochs: Vec<String> = state.last.iter().map(|position| position.epoch.clone()).collect();
        epochs.sort();
        let heard = self.0.entry(cell.to_owned()).or_default();
        if epochs == heard.last {
            return false;
        }
        let came_back = epochs == heard.previous_epochs && !epochs.is_empty() && !heard.last.is_empty();
        heard.previous_epochs = std::mem::replace(&mut heard.last, epochs);
        came_back && !std::mem::replace(&mut heard.is_reported, true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::CellName;
    use panelprep_store::office::Position;

    #[test]
    fn a_store_that_was_brought_back_is_one_cell_and_two_stores_in_turn_are_two() {
        let told = |epochs: &[&str]| {
            let mut state = CellState::new(&CellName::new("a").expect("a name"));
            let position = |epoch: &&str| Position { epoch: (*epoch).to_owned(), number: 1 };
            state.last = epochs.iter().map(position).collect();
            state
        };
        let mut names = Names::default();
        for epochs in [&["1"][..], &["1"], &["1", "2"], &["3"], &["3", "4"]] {
            assert!(!names.detect_duplicate_name("a", &told(epochs)), "{epochs:?}");
        }
        let found: Vec<bool> = [&["5"][..], &["6"], &["5"], &["6"]]
            .iter()
            .map(|epochs| names.detect_duplicate_name("b", &told(epochs)))
            .collect();
        assert_eq!(found, [false, false, true, false], "told once");
    }
}
