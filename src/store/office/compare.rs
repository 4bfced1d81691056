//! Compares the data of a cell with the data of the office.

use super::position::{ListEntry, Position};
use std::collections::BTreeMap;

/// Largest number of listed messages of one kind; further messages are only counted.
const MAX_MESSAGES: usize = 50;

/// The result of a comparison.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Comparison {
    /// Number of items that cell and office have with the same hash.
    pub equal_items: u64,
    /// The differences, as text.
    pub differences: Vec<String>,
}

/// Compares the office's list of a cell with the cell's own list.
pub fn compare(cell: &[ListEntry], office: &[ListEntry]) -> Comparison {
    let by_position = |list: &[ListEntry]| -> BTreeMap<Position, ListEntry> {
        list.iter().map(|line| (line.position.clone(), line.clone())).collect()
    };
    let (cell, mut office) = (by_position(cell), by_position(office));
    let mut compared = Comparison::default();
    let (mut missing, mut other) = (Vec::new(), Vec::new());
    for (position, line) in cell {
        match office.remove(&position) {
            Some(found) if found == line => compared.equal_items += 1,
            Some(found) => other.push(format!(
                "{} differs: the cell has a {} with the SHA-256 {}, the office has a {} with {}",
                name_position(&position),
                line.kind.keyword(),
                line.hash,
                found.kind.keyword(),
                found.hash
            )),
            None => missing.push(format!(
                "{} is not in the office yet: {}",
                name_position(&position),
                line.kind.keyword()
            )),
        }
    }
    let more =
        office.keys().map(|position| format!("{} is in the office, but not in the cell", name_position(position)));
    let more: Vec<String> = more.collect();
    for (mut words, of_all) in
        [(other, "differ"), (missing, "are not in the office"), (more, "are not in the cell")]
    {
        let rest = words.len().saturating_sub(MAX_MESSAGES);
        words.truncate(MAX_MESSAGES);
        compared.differences.append(&mut words);
        compared.differences.extend((rest > 0).then(|| format!("{rest} more {of_all}")));
    }
    compared
}

fn name_position(position: &Position) -> String {
    format!("number {} of epoch {}", position.number, position.epoch)
}
