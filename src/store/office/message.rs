//! A message: one line of JSON that describes the content, then the content's bytes as the cell has them.

use super::body::{Body, CycleEnd, ItemEnvelope, NamedFile, VerificationSeen};
use super::error::OfficeError;
use super::position::{Kind, Position};
use crate::signing::{PublicKey, Statement};
use panelprep_cell::cell::CellName;
use panelprep_cell::files::{content_hash, hex, is_hex, parse_hex};
use serde::{Deserialize, Serialize};

const FORM: &str = "panelprep-office-1";
/// The longest head, bytes: a record names about a hundred files.
const HEAD_BYTES: usize = 1 << 20;

/// A message of a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Name of the cell.
    pub cell: CellName,
    /// The item.
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
    /// Returns the bytes to send.
    ///
    /// # Errors
    /// If JSON cannot represent the head.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        let ItemEnvelope { position, unix_ms, body } = &self.envelope;
        let signed = match body {
            Body::Signature { signature, public_key, files, .. } => {
                Some(SignedHead { signature: hex(signature), public_key: public_key.clone(), files: files.clone() })
            }
            Body::Cycle(_) | Body::Verification(_) => None,
        };
        let head = Head {
            form: FORM.to_owned(),
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

    /// Reads a message. Its content must have the hash that the head states, must be readable as its kind, and must be
    /// signed with the key that the message names. The caller must check that this key is the cell's.
    ///
    /// # Errors
    /// If one of these conditions is not met.
    pub fn read(bytes: &[u8]) -> Result<Self, OfficeError> {
        let end = bytes.iter().take(HEAD_BYTES).position(|byte| *byte == b'\n');
        let Some(end) = end else {
            return Err(OfficeError::form_error("head of a message", "the line end is missing"));
        };
        let head = |problem: String| OfficeError::form_error("head of a message", problem);
        let read: Head = serde_json::from_slice(&bytes[..end]).map_err(|error| head(error.to_string()))?;
        if read.form != FORM {
            return Err(head(format!(
                "the field \"form\" is \"{}\", expected \"{FORM}\"",
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
                let _: VerificationSeen = parse_content(&content, "verification")?;
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

/// Checks that a text is the name of an epoch.
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
