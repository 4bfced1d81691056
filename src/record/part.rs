//! The part that a cycle is about, as it is named where the cycle is started.
//!
//! It is kept as a TOML text with the cycle, under the name [`PART`]. Whether a name can be kept is decided where it is given.

use serde::{Deserialize, Serialize};

/// The name under which a cycle keeps its part.
pub const PART: &str = "part";

/// Which part a cycle is about, as far as it is known.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartNames {
    /// The part's serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// The work order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// Who operates the cell, as that person was named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

impl PartNames {
    /// The part as the text of a cycle names it; `None` where the text is no such text.
    pub fn read(text: &str) -> Option<Self> {
        toml::from_str(text).ok()
    }
}
