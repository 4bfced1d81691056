//! The content of a message to the office.

use super::position::{Kind, ListEntry, Position};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::{CycleId, PartNames};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A named item that the office must receive.
#[derive(Debug, Clone, PartialEq)]
pub struct ItemEnvelope {
    /// Its name.
    pub position: Position,
    /// The time at which the cell wrote the item, ms since 1970.
    pub unix_ms: i64,
    /// Its content.
    pub body: Body,
}

/// The content that is sent. Each content is canonical JSON and is named by its hash.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// A [`CycleEnd`].
    Cycle(Vec<u8>),
    /// A signed statement.
    Signature {
        /// The bytes that are signed (`signing::Statement`).
        statement: Vec<u8>,
        /// The signature, 64 bytes.
        signature: Vec<u8>,
        /// The key that verifies it, 64 hexadecimal digits.
        public_key: String,
        /// The files that the statement names and that are sent.
        files: Vec<NamedFile>,
    },
    /// A [`VerificationSeen`].
    Verification(Vec<u8>),
}

impl Body {
    /// Returns the kind of the item.
    pub fn kind(&self) -> Kind {
        match self {
            Body::Cycle(_) => Kind::Cycle,
            Body::Signature { .. } => Kind::Signature,
            Body::Verification(_) => Kind::Verification,
        }
    }

    /// Returns the bytes from which the hash is calculated.
    pub fn content(&self) -> &[u8] {
        match self {
            Body::Cycle(content) | Body::Verification(content) => content,
            Body::Signature { statement, .. } => statement,
        }
    }
}

impl ItemEnvelope {
    /// Returns the item's line in a list.
    pub fn list_line(&self) -> ListEntry {
        ListEntry {
            position: self.position.clone(),
            kind: self.body.kind(),
            hash: content_hash(self.body.content()),
        }
    }
}

/// A file that a record names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// Purpose of the file in the record, such as "picture overlay" or "recipe".
    pub name: String,
    /// Its SHA-256.
    pub hash: String,
    /// The reason why the cell no longer has the file and does not send it; `None` if it is sent.
    pub gone: Option<String>,
}

/// The end of a cycle, as in the store's row; its signed record follows as a statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CycleEnd {
    /// Number of the cycle in the cell's store.
    pub cycle: CycleId,
    /// Start of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// End of the cycle, s since 1970.
    pub ended_unix_s: Option<i64>,
    /// The panel.
    pub panel: String,
    /// The version of the taught data.
    pub taught_version: String,
    /// SHA-256 of the recipe.
    pub recipe_hash: String,
    /// The program's version.
    pub program_version: String,
    /// Its verdict's word.
    pub verdict: String,
    /// The verdict's reasons as the store has them: a list of objects with code and message.
    pub reasons: Value,
    /// The part; `None` if no part was named.
    pub part: Option<PartNames>,
}

/// A verification of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerificationSeen {
    /// The verified item: `scanner`, `flange_camera`, `tool` or `tool_force`.
    pub subject: String,
    /// The measured error, mm; for a force, N.
    pub error: f64,
    /// The allowed error, in the same unit.
    pub limit: f64,
    /// Hash of the calibration files.
    pub calibration_hash: String,
    /// Time of the verification, s since 1970.
    pub at_unix_s: i64,
}
