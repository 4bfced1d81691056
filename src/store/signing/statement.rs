//! A statement of the cell, or of a person at the cell, about a cycle, with its position in the cell's chain of
//! statements.

use super::canonical::{canonical, restore_large_numbers};
use super::key::SigningError;
use panelprep_cell::files::content_hash;
use panelprep_cell::record::{CycleId, CycleRecord, PartNames};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Identifier of the format of a statement.
pub const STATEMENT_FORMAT: &str = "panelprep-record-1";
/// Fields of a record with integers that may be too large for canonical JSON: the number of a plan.
const LARGE_NUMBER_FIELDS: [&str; 1] = ["plan"];
/// Identifier of the format of a head.
pub const HEAD_FORMAT: &str = "panelprep-record-head-1";
/// The value of `previous` in the first statement of a cell.
pub const CHAIN_START_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// A statement: one link of the cell's chain of signed records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statement {
    /// The identifier of the format, [`STATEMENT_FORMAT`].
    pub form: String,
    /// Number of the statement in the chain, from 1 without gaps, over all cycles of the cell.
    pub number: u64,
    /// SHA-256 of the previous statement; [`CHAIN_START_HASH`] in the first statement.
    pub previous: String,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// The public key of the signature, 64 hexadecimal digits.
    pub public_key: String,
    /// The last position in the store's chain of rows at the time of the signature.
    pub store: SignedChainPosition,
    /// The content of the statement.
    pub says: StatementContent,
}

/// A position in the store's chain of rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedChainPosition {
    /// Number of the link, from 1; 0 before the first link.
    pub link: i64,
    /// SHA-256 of the link.
    pub hash: String,
}

/// The content of a statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StatementContent {
    /// The result of a cycle, signed by the cell.
    Cycle(SignedCycle),
    /// The signature of a person on the record of a cycle.
    Person(PersonSignature),
}

/// The record of a cycle and the names of its part, as signed by the cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SignedCycle {
    /// Number of the cycle in the store.
    pub id: CycleId,
    /// The names of the part; `None` if no name was stated.
    pub part: Option<PartNames>,
    /// The [`CycleRecord`] as a JSON value, so that the record of another program version can be read too.
    pub record: Value,
}

impl SignedCycle {
    /// Creates the content to sign from the record of a cycle.
    ///
    /// # Errors
    /// If JSON cannot represent the record.
    pub fn new(record: &CycleRecord, part: Option<PartNames>) -> Result<Self, SigningError> {
        let bytes = canonical(record)?;
        // The value is parsed from the bytes, so that it is equal to the record in a file.
        let record_value = serde_json::from_slice(&bytes).map_err(SigningError::form_error)?;
        Ok(SignedCycle { id: record.id, part, record: record_value })
    }
}

/// A person's signature on the record of a cycle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonSignature {
    /// Number of the cycle.
    pub cycle: CycleId,
    /// SHA-256 of the cell's statement about the cycle; the signature is valid only for this statement.
    pub record_hash: String,
    /// The person's printed name.
    pub name: String,
    /// The account with which the person was logged in.
    pub user: String,
    /// The meaning of the signature.
    pub meaning: Meaning,
    /// The person's remark, if there is one.
    pub remark: Option<String>,
    /// Values that the cell does not measure, as stated by the person.
    #[serde(default, skip_serializing_if = "StatedValues::is_empty")]
    pub values: StatedValues,
}

/// Values that the cell does not measure, as stated by the person who signs. A value is `None` if it was not stated.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedValues {
    /// The water: kind, conductivity, temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub water: Option<String>,
    /// The lamp: kind, illuminance at the panel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamp: Option<String>,
    /// The ambient temperature and humidity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ambient: Option<String>,
    /// The abrasive: product, grit, lot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub abrasive: Option<String>,
}

impl StatedValues {
    /// Returns whether no value was stated.
    pub fn is_empty(&self) -> bool {
        *self == StatedValues::default()
    }

    /// Returns the values with their names, in the order of the printed page.
    pub fn named(&self) -> [(&'static str, Option<&String>); 4] {
        let StatedValues { water, lamp, ambient, abrasive } = self;
        [
            ("water", water.as_ref()),
            ("lamp", lamp.as_ref()),
            ("ambient", ambient.as_ref()),
            ("abrasive", abrasive.as_ref()),
        ]
    }
}

/// The meaning of a person's signature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meaning {
    /// The part was inspected and is released.
    InspectedAndReleased,
    /// The part was inspected and is not released.
    InspectedAndNotReleased,
    /// The record was reviewed.
    Reviewed,
    /// A deviation stated in the record is accepted.
    DeviationAccepted,
    /// An earlier release is withdrawn: the part is not released.
    ReleaseWithdrawn,
}

impl Meaning {
    /// All meanings, in the order of the selection list.
    pub const ALL: [Meaning; 5] = [
        Meaning::InspectedAndReleased,
        Meaning::InspectedAndNotReleased,
        Meaning::Reviewed,
        Meaning::DeviationAccepted,
        Meaning::ReleaseWithdrawn,
    ];

    /// Returns the meaning of the signature as it is printed on the signed page, such as "released".
    pub fn printed_text(self) -> &'static str {
        match self {
            Meaning::InspectedAndReleased => "inspected and released",
            Meaning::InspectedAndNotReleased => "inspected and not released",
            Meaning::Reviewed => "reviewed",
            Meaning::DeviationAccepted => "deviation accepted",
            Meaning::ReleaseWithdrawn => "release withdrawn",
        }
    }
}

impl SignedCycle {
    /// Parses the record of the cycle.
    ///
    /// # Errors
    /// If the record cannot be parsed, for example because another version of this program wrote it.
    pub fn cycle_record(&self) -> Result<CycleRecord, SigningError> {
        serde_json::from_value(restore_large_numbers(self.record.clone(), &LARGE_NUMBER_FIELDS))
            .map_err(SigningError::form_error)
    }
}

impl Statement {
    /// Returns the statement in canonical JSON, which is signed.
    ///
    /// # Errors
    /// If JSON cannot represent the statement.
    pub fn canonical(&self) -> Result<Vec<u8>, SigningError> {
        canonical(self)
    }

    /// Parses a statement in canonical JSON.
    ///
    /// # Errors
    /// If the bytes are not a valid statement, or not in canonical form.
    pub fn read(bytes: &[u8]) -> Result<Self, SigningError> {
        let statement: Statement = read(bytes)?;
        match statement.form.as_str() {
            STATEMENT_FORMAT => Ok(statement),
            other => Err(SigningError::form_error(format!(
                "the field \"form\" is \"{other}\", expected \"{STATEMENT_FORMAT}\""
            ))),
        }
    }

    /// Returns the cycle to which the statement refers.
    pub fn cycle(&self) -> CycleId {
        match &self.says {
            StatementContent::Cycle(cycle) => cycle.id,
            StatementContent::Person(person) => person.cycle,
        }
    }
}

/// The head of the chain of statements at one moment. It is kept elsewhere, and shows later whether statements were
/// removed from the end of the chain.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignedHead {
    /// The identifier of the format, [`HEAD_FORMAT`].
    pub form: String,
    /// Number of the last statement; 0 if there is none.
    pub number: u64,
    /// SHA-256 of the last statement.
    pub hash: String,
    /// Time at which the head was written, ms since 1970.
    pub unix_ms: i64,
    /// The public key of the signature on the head.
    pub public_key: String,
}

impl SignedHead {
    /// Parses a head in canonical JSON.
    ///
    /// # Errors
    /// If the bytes are not a valid head, or not in canonical form.
    pub fn read(bytes: &[u8]) -> Result<Self, SigningError> {
        let head: SignedHead = read(bytes)?;
        match head.form.as_str() {
            HEAD_FORMAT => Ok(head),
            other => Err(SigningError::form_error(format!(
                "the field \"form\" is \"{other}\", expected \"{HEAD_FORMAT}\""
            ))),
        }
    }
}

/// Parses JSON that must be in canonical form.
pub(super) fn read<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, SigningError> {
    let value: Value = serde_json::from_slice(bytes).map_err(SigningError::form_error)?;
    if canonical(&value)? != bytes {
        return Err(SigningError::form_error("the JSON text is not in canonical form"));
    }
    serde_json::from_value(value).map_err(SigningError::form_error)
}

/// Returns the description and the SHA-256 of each file that the cell's statement about a cycle names: the files used
/// in the cycle, and all pictures.
pub fn named_files(cycle: &SignedCycle) -> Vec<(String, String)> {
    let text = |value: &Value, name: &str| value.get(name).and_then(Value::as_str).map(str::to_owned);
    let list = |value: &Value, name: &str| value.get(name).and_then(Value::as_array).cloned().unwrap_or_default();
    let record = &cycle.record;
    let mut files: Vec<(String, String)> =
        text(record, "recipe_hash").map(|hash| ("recipe".to_owned(), hash)).into_iter().collect();
    let findings = list(record, "findings");
    let shown = findings.iter().flat_map(|finding| {
        let pictures = list(finding, "pictures").into_iter().map(|picture| ("picture ", picture));
        let shots = list(finding, "shots").into_iter().map(|shot| ("shot ", shot));
        pictures.chain(shots).collect::<Vec<_>>()
    });
    let used = list(record, "files").into_iter().map(|file| ("", file));
    for (kind, file) in used.chain(shown) {
        if let (Some(name), Some(hash)) = (text(&file, "name"), text(&file, "hash")) {
            files.push((format!("{kind}{name}"), hash));
        }
    }
    files
}

/// Returns the SHA-256 by which the next statement, or a person's signature, refers to these bytes.
pub(super) fn hash(bytes: &[u8]) -> String {
    content_hash(bytes)
}
