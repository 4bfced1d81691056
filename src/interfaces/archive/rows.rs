//! The database rows that are derived from a message, for the pages of the office. Pure functions.

use panelprep_store::history::{KnownQuantity, PastCycle, Quantity};
use panelprep_store::office::{Body, CycleEnd, Message, VerificationSeen};
use panelprep_store::signing::{SignedCycle, Statement, StatementContent};
use strum::IntoEnumIterator;

/// The rows of a message.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Rows {
    Cycle(CycleEnd),
    Verification(VerificationSeen),
    Signature(SignatureRows),
}

/// Rows of a statement's signature.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SignatureRows {
    pub cycle: i64,
    /// The number of the statement among all statements of its cell.
    pub statement: u64,
    pub unix_ms: i64,
    /// The person who signed and the meaning of the signature, as text; `None` for the cell itself.
    pub person: Option<(String, &'static str)>,
    /// The numbers of the cycle, if the cell's own statement contains them and this program can read its record.
    pub quantities: Option<Quantities>,
}

/// Measured quantities of a cycle.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Quantities {
    pub started_unix_s: i64,
    pub panel: String,
    /// Keyword, value and limit as JSON.
    pub values: Vec<(&'static str, f64, String)>,
}

impl Rows {
    /// Derives the rows from a message, whose content was already read when it arrived.
    pub fn from_message(message: &Message) -> Result<Self, String> {
        let wrong = |error: serde_json::Error| error.to_string();
        match &message.envelope.body {
            Body::Cycle(content) => serde_json::from_slice(content).map(Rows::Cycle).map_err(wrong),
            Body::Verification(content) => serde_json::from_slice(content).map(Rows::Verification).map_err(wrong),
            Body::Signature { statement, .. } => {
                let statement = Statement::read(statement).map_err(|error| error.to_string())?;
                Ok(Rows::Signature(signature(&statement)))
            }
        }
    }
}

fn signature(statement: &Statement) -> SignatureRows {
    let (person, quantities) = match &statement.says {
        StatementContent::Person(person) => (Some((person.name.clone(), person.meaning.printed_text())), None),
        StatementContent::Cycle(cycle) => (None, extract_quantities(cycle)),
    };
    SignatureRows {
        cycle: statement.cycle().0,
        statement: statement.number,
        unix_ms: statement.unix_ms,
        person,
        quantities,
    }
}

/// Returns the quantities of a cycle; `None` if the record is of another version of the program and cannot be read.
/// The archive stores such a record all the same.
fn extract_quantities(cycle: &SignedCycle) -> Option<Quantities> {
    let record = cycle.cycle_record().ok()?;
    let past = PastCycle { record, part: cycle.part.clone(), disc: None };
    // As in the cell's own trends.
    if past.record.is_air_run() || past.record.has_no_part() {
        return None;
    }
    let value = |known: KnownQuantity| {
        let (value, limit) = Quantity::Known(known).value_and_limit(&past)?;
        value.is_finite().then(|| (known.keyword(), value, serde_json::to_string(&limit).unwrap_or_default()))
    };
    let values = KnownQuantity::iter().filter_map(value).collect();
    Some(Quantities { started_unix_s: past.record.started_unix_s, panel: past.record.panel, values })
}
