//! The name of an item for the office, and its position in a list.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// A position among all items that one store sends.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Position {
    /// A random name, 32 hexadecimal digits; a store that does not have all of its history begins a new epoch.
    pub epoch: String,
    /// The number, from 1, without gaps; 0 before the first item.
    pub number: u64,
}

/// The kind of an item.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Kind {
    /// A cycle has ended.
    Cycle,
    /// A statement was signed, by the cell or by a person.
    Signature,
    /// A calibration was verified.
    Verification,
}

impl Kind {
    /// Returns the keyword of the kind.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns the kind with this keyword.
    pub fn from_keyword(word: &str) -> Option<Kind> {
        word.parse().ok()
    }
}

/// One line of a list that is compared between the cell and the office.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListEntry {
    /// Its name.
    #[serde(flatten)]
    pub position: Position,
    /// The kind of the item.
    pub kind: Kind,
    /// SHA-256 of the item's content.
    pub hash: String,
}
