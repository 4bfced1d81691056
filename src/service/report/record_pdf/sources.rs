//! The data from which the page is made.

use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{CycleRecord, PartNames};
use panelprep_store::signing::StatedValues;

/// The data from which the page is made.
#[derive(Debug, Clone, Copy)]
pub struct RecordSources<'s> {
    /// The cycle.
    pub record: &'s CycleRecord,
    /// The cycle's part; `None` if none was named.
    pub part: Option<&'s PartNames>,
    /// The cycle's recipe; `None` if the stored copy is missing.
    pub recipe: Option<&'s Recipe>,
    /// Who approved the recipe and when, in words; `None` if the store has no approval of this text.
    pub recipe_approval: Option<&'s str>,
    /// What measured.
    pub equipment: &'s [Equipment],
    /// Earlier cycles that abraded the same part; `None` if no serial number was named.
    pub earlier: Option<&'s [EarlierCycle]>,
    /// The people who signed, in order.
    pub signatures: &'s [PrintedSignature],
}

/// A camera, a tool or a mount with its calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equipment {
    /// The kind of equipment, such as "scanner, lens".
    pub what: String,
    /// Its serial number; `None` if its calibration names none.
    pub serial: Option<String>,
    /// The day of the calibration.
    pub calibrated: Option<String>,
    /// SHA-256 of the calibration file.
    pub hash: String,
    /// The last verification before the cycle; `None` if there is none.
    pub verified: Option<LastVerification>,
}

/// A verification against a known target, as text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LastVerification {
    /// The day.
    pub day: String,
    /// The error found and the limit.
    pub error: String,
}

/// An earlier cycle that abraded the same part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EarlierCycle {
    /// Its number.
    pub cycle: i64,
    /// Start of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// Its passes.
    pub passes: usize,
}

/// A signature, as it is printed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrintedSignature {
    /// The printed name.
    pub name: String,
    /// The time.
    pub time: String,
    /// Meaning of the signature.
    pub meaning: String,
    /// The record's number in the chain of signed records, and the record's hash.
    pub chain_position: String,
    /// A person who decides whether the part is released.
    pub is_deciding: bool,
    /// The values that the cell does not measure, as this person stated them.
    pub values: StatedValues,
}
