//! The part in the cell in a cycle, as it was named when the cycle was started. This module checks no name: the module
//! that accepts a name checks it.

use serde::{Deserialize, Serialize};

/// The names of a cycle's part, as far as they are known.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartNames {
    /// The part's serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// The work order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// The name of the person who operates the cell, as stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

/// A person's statement at a start after the store was restored from a backup: how often the part was abraded in the
/// cycles that the restored store lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LostPasses {
    /// The number of passes.
    pub passes: u8,
}

impl LostPasses {
    /// Name of the stored file with this statement, among a cycle's [`files`](super::CycleRecord::files).
    pub const FILE: &'static str = "lost_passes";

    /// Reads the statement from the stored file; `None` if this program did not write the text.
    pub fn read(text: &str) -> Option<LostPasses> {
        toml::from_str(text).ok()
    }
}

/// Describes a part in a sentence by its serial number, which is empty for a part without one.
pub fn describe_part(serial: &str) -> String {
    if serial.is_empty() { "a part without a serial number".to_owned() } else { format!("the part {serial}") }
}

impl PartNames {
    /// Name of the stored file with these names, among a cycle's [`files`](super::CycleRecord::files).
    pub const FILE: &'static str = "part";

    /// Reads the names from the stored file; `None` if this program did not write the text.
    pub fn read(text: &str) -> Option<PartNames> {
        toml::from_str(text).ok()
    }
}
