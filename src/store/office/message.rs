//! A message to the office server: one line of JSON (the head), and the content. Also the position and the kind of each
//! item, the contents, and the errors of invalid messages.

use crate::signing::{PublicKey, Statement};
use panelprep_cell::cell::CellName;
use panelprep_cell::files::{content_hash, hex, is_hex, parse_hex};
use panelprep_cell::record::{CycleId, PartNames};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use strum::{EnumString, IntoStaticStr, VariantArray};

const MESSAGE_FORMAT: &str = "panelprep-office-1";
/// Maximum size of a head, bytes; the head of a record names about a hundred files.
const MAX_HEAD_BYTES: usize = 1 << 20;

/// A message from a cell to the office server.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// The cell that sends the message.
    pub cell: CellName,
    /// The item that the message contains.
    pub envelope: ItemEnvelope,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    form: String,
    cell: String,
    epoch: String,
    number: u64,
    kind: Kind,
    unix_ms: i64,
    hash: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    signed: Option<SignedHead>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SignedHead {
    signature: String,
    public_key: String,
    files: Vec<NamedFile>,
}

impl Message {
    /// Encodes the message for sending.
    ///
    /// # Errors
    /// If JSON cannot represent its head.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        let ItemEnvelope { position, unix_ms, body } = &self.envelope;
        let signed = match body {
            Body::Signature { signature, public_key, files, .. } => {
                Some(SignedHead { signature: hex(signature), public_key: public_key.clone(), files: files.clone() })
            }
            Body::Cycle(_) | Body::Verification(_) => None,
        };
        let head = Head {
            form: MESSAGE_FORMAT.to_owned(),
            cell: self.cell.as_str().to_owned(),
            epoch: position.epoch.clone(),
            number: position.number,
            kind: body.kind(),
            unix_ms: *unix_ms,
            hash: content_hash(body.content()),
            signed,
        };
        let mut bytes =
            serde_json::to_vec(&head).map_err(|error| OfficeError::form_error("head of a message", error))?;
        bytes.push(b'\n');
        bytes.extend_from_slice(body.content());
        Ok(bytes)
    }

    /// Parses a message. The content must have the hash in the head, must be valid for its kind, and must be signed
    /// with the key that the message names. The caller must check that this is the key of the cell.
    ///
    /// # Errors
    /// If one of these conditions is not satisfied.
    pub fn read(bytes: &[u8]) -> Result<Self, OfficeError> {
        let end = bytes.iter().take(MAX_HEAD_BYTES).position(|byte| *byte == b'\n');
        let Some(end) = end else {
            return Err(OfficeError::form_error("head of a message", "the end of the line is missing"));
        };
        let head = |problem: String| OfficeError::form_error("head of a message", problem);
        let read: Head = serde_json::from_slice(&bytes[..end]).map_err(|error| head(error.to_string()))?;
        if read.form != MESSAGE_FORMAT {
            return Err(head(format!(
                "the field \"form\" is \"{}\", expected \"{MESSAGE_FORMAT}\"",
                read.form.escape_debug()
            )));
        }
        let cell = CellName::new(&read.cell).map_err(head)?;
        let position = position(&read).map_err(head)?;
        let content = bytes[end + 1..].to_vec();
        let found = content_hash(&content);
        if found != read.hash {
            return Err(OfficeError::Hash { number: read.number, found, stated: read.hash });
        }
        let body = match (read.kind, read.signed) {
            (Kind::Cycle, None) => {
                let _: CycleEnd = parse_content(&content, "end of a cycle")?;
                Body::Cycle(content)
            }
            (Kind::Verification, None) => {
                let _: OfficeVerification = parse_content(&content, "verification")?;
                Body::Verification(content)
            }
            (Kind::Signature, Some(signed)) => signature(content, signed, read.number)?,
            (kind, _) => {
                return Err(head(format!("the signature of a {} is missing or not permitted", kind.keyword())));
            }
        };
        Ok(Message { cell, envelope: ItemEnvelope { position, unix_ms: read.unix_ms, body } })
    }
}

fn parse_content<T: serde::de::DeserializeOwned>(content: &[u8], what: &'static str) -> Result<T, OfficeError> {
    serde_json::from_slice(content).map_err(|error| OfficeError::form_error(what, error))
}

fn position(head: &Head) -> Result<Position, String> {
    check_epoch_name(&head.epoch)?;
    if head.number == 0 || i64::try_from(head.number).is_err() {
        return Err(format!("the record number is {}, valid: 1 or larger", head.number));
    }
    Ok(Position { epoch: head.epoch.clone(), number: head.number })
}

/// Checks that a text is a valid name of an epoch.
pub(super) fn check_epoch_name(epoch: &str) -> Result<(), String> {
    match is_hex(epoch, 32) {
        true => Ok(()),
        false => Err(format!("the epoch is \"{}\", valid: 32 hexadecimal digits", epoch.escape_debug())),
    }
}

fn signature(statement: Vec<u8>, head: SignedHead, number: u64) -> Result<Body, OfficeError> {
    let wrong = |problem: String| OfficeError::Signature { number, problem };
    let signature =
        parse_hex(&head.signature).ok_or_else(|| wrong("the signature is not a hexadecimal text".to_owned()))?;
    let key = PublicKey::from_hex(&head.public_key).map_err(|error| wrong(error.to_string()))?;
    let names = Statement::read(&statement).map_err(|error| wrong(error.to_string()))?.public_key;
    if names != head.public_key || !key.is_valid_signature(&statement, &signature) {
        return Err(wrong(format!("the signature does not match the content and the key {}", head.public_key)));
    }
    if let Some(file) = head.files.iter().find(|file| !is_hex(&file.hash, 64)) {
        return Err(wrong(format!("the file {} has no valid SHA-256", file.name.escape_debug())));
    }
    Ok(Body::Signature { statement, signature, public_key: head.public_key, files: head.files })
}

/// The position of an item among all items of a store that are sent.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Position {
    /// The random name of the epoch, 32 hexadecimal digits. A store begins a new epoch if its history is incomplete.
    pub epoch: String,
    /// The number of the item within its epoch, from 1 without gaps; 0 before the first item.
    pub number: u64,
}

/// The kinds of items.
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
    /// The end of a cycle.
    Cycle,
    /// A statement that the cell or a person has signed.
    Signature,
    /// A verification of a calibration.
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

/// An item in the list by which the data of the cell and of the office server are compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListEntry {
    /// The position of the item.
    #[serde(flatten)]
    pub position: Position,
    /// The kind of the item.
    pub kind: Kind,
    /// SHA-256 of the item's content.
    pub hash: String,
}

/// An item that the office server must receive.
#[derive(Debug, Clone, PartialEq)]
pub struct ItemEnvelope {
    /// The position of the item.
    pub position: Position,
    /// Time at which the cell stored the item, ms since 1970.
    pub unix_ms: i64,
    /// The content of the item.
    pub body: Body,
}

/// The content of an item, in canonical JSON.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// A [`CycleEnd`].
    Cycle(Vec<u8>),
    /// A signed statement.
    Signature {
        /// The signed bytes (`signing::Statement`).
        statement: Vec<u8>,
        /// The signature, 64 bytes.
        signature: Vec<u8>,
        /// The public key of the signature, 64 hexadecimal digits.
        public_key: String,
        /// The files that the statement names.
        files: Vec<NamedFile>,
    },
    /// A [`OfficeVerification`].
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

    /// Returns the bytes of which the hash is computed.
    pub fn content(&self) -> &[u8] {
        match self {
            Body::Cycle(content) | Body::Verification(content) => content,
            Body::Signature { statement, .. } => statement,
        }
    }
}

impl ItemEnvelope {
    /// Returns the list entry of the item.
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
    /// The purpose of the file in the record, such as "picture overlay" or "recipe".
    pub name: String,
    /// SHA-256 of the file.
    pub hash: String,
    /// The reason why the cell no longer has the file and cannot send it; `None` if it is sent.
    pub gone: Option<String>,
}

/// The end of a cycle, from its row in the store. The signed record of the cycle is sent later as a statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CycleEnd {
    /// Number of the cycle in the cell's store.
    pub cycle: CycleId,
    /// Start time of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// End time of the cycle, s since 1970.
    pub ended_unix_s: Option<i64>,
    /// Name of the panel.
    pub panel: String,
    /// The version of the taught data.
    pub taught_version: String,
    /// SHA-256 of the recipe's text.
    pub recipe_hash: String,
    /// The version of the program.
    pub program_version: String,
    /// The keyword of the verdict.
    pub verdict: String,
    /// The reasons of the verdict: a list of objects with code and message.
    pub reasons: Value,
    /// The names of the part; `None` if no name was stated.
    pub part: Option<PartNames>,
}

/// A verification of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OfficeVerification {
    /// What was verified: `scanner`, `flange_camera`, `tool` or `tool_force`.
    pub subject: String,
    /// The measured error, mm; N for a force.
    pub error: f64,
    /// The maximum error, in the same unit.
    pub limit: f64,
    /// Hash of the calibration files that were verified.
    pub calibration_hash: String,
    /// Time of the verification, s since 1970.
    pub at_unix_s: i64,
}

/// The reason why a message is not valid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OfficeError {
    /// A part of the message cannot be parsed.
    #[error("the {what} cannot be read: {problem}")]
    Form {
        /// What cannot be parsed, such as "head of a message".
        what: &'static str,
        /// The problem.
        problem: String,
    },
    /// The hash of the content differs from the hash in the head.
    #[error("the content of record {number} has the SHA-256 {found}, but its head states {stated}")]
    Hash {
        /// Number of the record.
        number: u64,
        /// The hash of the content.
        found: String,
        /// The hash in the head.
        stated: String,
    },
    /// The message is larger than any valid message.
    #[error("the message has {found} (limit {allowed})")]
    Large {
        /// The size of the message, such as "5000 parts".
        found: String,
        /// The maximum size, in the same unit.
        allowed: String,
    },
    /// The parts of an item state different total numbers of parts.
    #[error("part {part} states a total of {found} parts, but another part stated {before}")]
    Parts {
        /// Number of the part.
        part: u32,
        /// The total number of parts that this part states.
        found: u32,
        /// The total number of parts that an earlier part has stated.
        before: u32,
    },
    /// The signature or the signed statement is not valid.
    #[error("record {number} does not match the signature of its cell: {problem}")]
    Signature {
        /// Number of the record.
        number: u64,
        /// The problem.
        problem: String,
    },
}

impl OfficeError {
    pub(super) fn form_error(what: &'static str, problem: impl ToString) -> Self {
        OfficeError::Form { what, problem: problem.to_string() }
    }
}
