//! A statement of the cell, or of a person at the cell, about a cycle, and its position among all statements of the
//! cell.

use super::canonical::{canonical, restore_large_numbers};
use super::key::SigningError;
use panelprep_cell::files::content_hash;
use panelprep_cell::record::{CycleId, CycleRecord, PartNames};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Identifier of the format of a statement.
pub const STATEMENT_FORMAT: &str = "panelprep-record-1";
/// Fields of a record whose numbers may be too large for canonical JSON: the number of a plan.
const LARGE_NUMBER_FIELDS: [&str; 1] = ["plan"];
/// Identifier of the format of a head.
pub const HEAD_FORMAT: &str = "panelprep-record-head-1";
/// The hash that the first statement of a cell contains, because it has no predecessor.
pub const CHAIN_START_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// One link of the chain of signed records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statement {
    /// [`STATEMENT_FORMAT`].
    pub form: String,
    /// The statement's number in the chain, from 1, without gaps over all cycles of the cell.
    pub number: u64,
    /// SHA-256 of the statement before it; [`CHAIN_START_HASH`] if there is none.
    pub previous: String,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// The key that signed the statement, 64 hexadecimal digits.
    pub public_key: String,
    /// The position of the store's chain of all its rows at that time.
    pub store: SignedChainPosition,
    /// Its content.
    pub says: StatementContent,
}

/// A position in the store's chain of rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedChainPosition {
    /// Number of the link, from 1; 0 before the first link.
    pub link: i64,
    /// Its SHA-256.
    pub hash: String,
}

/// The content of a statement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StatementContent {
    /// The cell's statement about a cycle.
    Cycle(SignedCycle),
    /// A person's statement about a cycle's record.
    Person(PersonSignature),
}

/// A cycle with its part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SignedCycle {
    /// Number of the cycle in the store.
    pub id: CycleId,
    /// The part; `None` if none was named.
    pub part: Option<PartNames>,
    /// The [`CycleRecord`]. It is stored as a JSON value, so that a record of another version of the program stays
    /// readable.
    pub record: Value,
}

impl SignedCycle {
    /// Creates the signed content from this record.
    ///
    /// # Errors
    /// If JSON cannot represent it.
    pub fn new(record: &CycleRecord, part: Option<PartNames>) -> Result<Self, SigningError> {
        let bytes = canonical(record)?;
        // The value is read back from the bytes, so that it compares equal to the record in a file.
        let record_value = serde_json::from_slice(&bytes).map_err(SigningError::form_error)?;
        Ok(SignedCycle { id: record.id, part, record: record_value })
    }
}

/// A person's statement about a record, with the person's printed name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonSignature {
    /// The cycle.
    pub cycle: CycleId,
    /// SHA-256 of the cell's statement of that cycle: the signature is valid only for this record.
    pub record_hash: String,
    /// The person's printed name.
    pub name: String,
    /// The account by which the person was recognized.
    pub user: String,
    /// The meaning of the signature.
    pub meaning: Meaning,
    /// The person's remark; `None` if there is none.
    pub remark: Option<String>,
    /// The values that the cell does not measure.
    #[serde(default, skip_serializing_if = "StatedValues::is_empty")]
    pub values: StatedValues,
}

/// Values that the cell does not measure, in the words of the person who signs; `None` if the person states none.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedValues {
    /// The water: kind, conductivity, temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub water: Option<String>,
    /// The lamp: kind, brightness at the panel.
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
    /// Returns whether the person states no value.
    pub fn is_empty(&self) -> bool {
        *self == StatedValues::default()
    }

    /// Returns the values with their names, in the order in which a page prints them.
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
    /// The part is released.
    InspectedAndReleased,
    /// The part is not released.
    InspectedAndNotReleased,
    /// The record was read.
    Reviewed,
    /// A deviation that the record states is accepted.
    DeviationAccepted,
    /// An earlier release is withdrawn: the part is not released.
    ReleaseWithdrawn,
}

impl Meaning {
    /// All meanings, in the order in which they are offered.
    pub const ALL: [Meaning; 5] = [
        Meaning::InspectedAndReleased,
        Meaning::InspectedAndNotReleased,
        Meaning::Reviewed,
        Meaning::DeviationAccepted,
        Meaning::ReleaseWithdrawn,
    ];

    /// Returns the printed text of the meaning.
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
    /// Returns the record as this program's own type.
    ///
    /// # Errors
    /// If it cannot be read, for example because another version of this program wrote it.
    pub fn cycle_record(&self) -> Result<CycleRecord, SigningError> {
        serde_json::from_value(restore_large_numbers(self.record.clone(), &LARGE_NUMBER_FIELDS))
            .map_err(SigningError::form_error)
    }
}

impl Statement {
    /// Returns the bytes that are signed.
    ///
    /// # Errors
    /// If JSON cannot represent the statement.
    pub fn canonical(&self) -> Result<Vec<u8>, SigningError> {
        canonical(self)
    }

    /// Reads a statement; its bytes must be in canonical form.
    ///
    /// # Errors
    /// If the bytes are not a statement, or are not in canonical form.
    pub fn read(bytes: &[u8]) -> Result<Self, SigningError> {
        let statement: Statement = read(bytes)?;
        match statement.form.as_str() {
            STATEMENT_FORMAT => Ok(statement),
            other => Err(SigningError::form_error(format!(
                "the field \"form\" is \"{other}\", expected \"{STATEMENT_FORMAT}\""
            ))),
        }
    }

    /// Returns the cycle that the statement is about.
    pub fn cycle(&self) -> CycleId {
        match &self.says {
            StatementContent::Cycle(cycle) => cycle.id,
            StatementContent::Person(person) => person.cycle,
        }
    }
}

/// The head of the chain at one moment, to be kept elsewhere: later it shows whether statements were removed from
/// the end.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignedHead {
    /// [`HEAD_FORMAT`].
    pub form: String,
    /// The number of the last statement; 0 if there is none.
    pub number: u64,
    /// Its SHA-256.
    pub hash: String,
    /// Time at which the head was written, ms since 1970.
    pub unix_ms: i64,
    /// The key that signed the head.
    pub public_key: String,
}

impl SignedHead {
    /// Reads a head.
    ///
    /// # Errors
    /// If the bytes are not a head, or are not in canonical form.
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

/// Reads a text that must be in canonical form.
pub(super) fn read<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, SigningError> {
    let value: Value = serde_json::from_slice(bytes).map_err(SigningError::form_error)?;
    if canonical(&value)? != bytes {
        return Err(SigningError::form_error("the JSON text is not in canonical form"));
    }
    serde_json::from_value(value).map_err(SigningError::form_error)
}

/// Lists the files that a cycle's statement names by their SHA-256: the files used in the cycle and every picture,
/// each with its description.
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

/// Returns the SHA-256 of these bytes, by which the next statement or a person's signature refers to them.
pub(super) fn hash(bytes: &[u8]) -> String {
    content_hash(bytes)
}
