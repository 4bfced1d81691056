//! `[office]`: the destination of the cell's records. Off until `broker` is set.

use super::broker::Broker;
use panelprep_base::config::Section;
use std::fmt;
use std::path::Path;

/// The maximum length of a cell's name, in characters.
const MAX_CHARACTERS: usize = 40;
const ALARM_DELAY_RANGE_MIN: std::ops::RangeInclusive<usize> = 1..=100_000;

/// The destination of the cell's records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Office {
    /// The broker that receives them.
    pub broker: Broker,
    /// The name that identifies this cell at the office.
    pub cell: CellName,
    /// A record that the office does not have after this many minutes raises an alarm.
    pub alarm_delay_min: usize,
}

/// The name of a cell: letters, digits, `-` and `_`, so that it can also be part of a subject, a message name and
/// an address.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellName(String);

impl CellName {
    /// Checks a name.
    ///
    /// # Errors
    /// If the name is not valid; the text states the valid characters.
    pub fn new(name: &str) -> Result<Self, String> {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !name.is_empty() && name.len() <= MAX_CHARACTERS && name.chars().all(is_allowed) {
            return Ok(CellName(name.to_owned()));
        }
        Err(format!(
            "found \"{}\", valid: 1 to {MAX_CHARACTERS} letters, digits, '-' and '_', such as \"cell-1\"",
            name.escape_debug()
        ))
    }

    /// The name as it is written.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for CellName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Reads the office. The outer `None` is a problem, the inner one means that no office is configured.
pub(super) fn parse_office(folder: &Path, section: &Section<'_, '_>) -> Option<Option<Office>> {
    let broker = Broker::parse(folder, section, "broker");
    let cell = section.parse::<Option<String>>("cell", (), Some(None));
    let behind_min = section.parse::<usize>("behind_min", ALARM_DELAY_RANGE_MIN, Some(60));
    // A wrong name is reported together with a wrong broker.
    let cell = cell.and_then(|name| match name.as_deref().map(CellName::new).transpose() {
        Ok(name) => Some(name),
        Err(problem) => {
            section.problem("cell", problem);
            None
        }
    });
    section.finish();
    let (Some(broker), Some(cell), Some(behind_min)) = (broker, cell, behind_min) else { return None };
    let Some(broker) = broker else {
        return section.missing_required(
            "broker",
            "the address of the office's broker, such as \"tls://office.example:4222\"",
        );
    };
    let Some(cell) = cell else {
        section.problem("cell", "is missing; state the name of this cell for the office, such as \"cell-1\"");
        return None;
    };
    Some(Some(Office { broker, cell, alarm_delay_min: behind_min }))
}

#[cfg(test)]
mod tests {
    use super::super::Cell;

    #[test]
    fn a_wrong_name_and_a_wrong_broker_are_reported_at_once() {
        let text = "[office]\ncell = 'c 1'\nbroker = 'nats://10.0.0.1:a'\n";
        let problems = Cell::check("cell.toml", text).expect_err("wrong").to_string();
        for words in ["office.cell: found \"c 1\"", "office.broker: found \"nats://10.0.0.1:a\""] {
            assert!(problems.contains(words), "{problems}");
        }
    }
}
