//! The messages between a cell and the office server that have no number, because the next message replaces the
//! previous one.
//!
//! A cell reports its state repeatedly. A report may be lost, because the next one follows soon. The office offers its
//! cells a recipe that was approved in the office. A cell never adopts the recipe automatically: a person at the cell
//! checks the difference and approves it like any other change.

use super::message::{OfficeError, Position};
use panelprep_cell::cell::CellName;
use panelprep_cell::files::content_hash;
use serde::{Deserialize, Serialize};

const STATE_FORMAT: &str = "panelprep-state-1";
/// Maximum size of a state, bytes.
const MAX_STATE_BYTES: usize = 64 * 1024;

/// The state that a cell reports.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellState {
    form: String,
    cell: String,
    /// Time of the cell's clock, ms since 1970.
    pub unix_ms: i64,
    /// The version of the program.
    pub version: String,
    /// The keyword of the state; `None` if the control loop does not reply.
    pub state: Option<String>,
    /// The current phase of the cycle in progress.
    pub phase: Option<String>,
    /// Name of the panel.
    pub panel: Option<String>,
    /// Number of the cycle.
    pub cycle: Option<i64>,
    /// The current waypoint, and the total number of waypoints of the path.
    pub waypoint: Option<[u32; 2]>,
    /// The reasons for the state: codes and messages.
    pub reasons: Vec<ReasonText>,
    /// Problems that persist between cycles, such as a full disk or a calibration that will expire.
    pub standing: Vec<ReasonText>,
    /// The position of the last item for the office server, for each epoch.
    pub last: Vec<Position>,
}

/// A reason: its code and its message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReasonText {
    /// Code of the reason.
    pub code: String,
    /// Message of the reason.
    pub message: String,
}

impl CellState {
    /// Creates the state of this cell with only its name.
    pub fn new(cell: &CellName) -> Self {
        CellState { form: STATE_FORMAT.to_owned(), cell: cell.as_str().to_owned(), ..CellState::default() }
    }

    /// Encodes the state for sending.
    ///
    /// # Errors
    /// If JSON cannot represent the state.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        serde_json::to_vec(self).map_err(|error| OfficeError::form_error("state of a cell", error))
    }

    /// Parses a state, and returns it with the name of its cell.
    ///
    /// # Errors
    /// If the bytes are not a valid state.
    pub fn read(bytes: &[u8]) -> Result<(CellName, Self), OfficeError> {
        let wrong = |problem: String| OfficeError::form_error("state of a cell", problem);
        if bytes.len() > MAX_STATE_BYTES {
            let [found, allowed] = [bytes.len(), MAX_STATE_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let state: CellState = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if state.form != STATE_FORMAT {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{STATE_FORMAT}\"",
                state.form.escape_debug()
            )));
        }
        Ok((CellName::new(&state.cell).map_err(wrong)?, state))
    }
}

const OFFER_FORMAT: &str = "panelprep-offer-1";
/// Maximum size of an offer, bytes.
const MAX_OFFER_BYTES: usize = 256 * 1_024;
/// Maximum length of a name or a reason, characters.
const MAX_TEXT_CHARACTERS: usize = 200;

/// A recipe that the office offers to its cells.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecipeOffer {
    form: String,
    /// The panel to which the recipe belongs.
    pub panel: String,
    /// The text of the recipe.
    pub text: String,
    /// The printed name of the person who approved the recipe in the office.
    pub by: String,
    /// The reason of the change, as stated by this person.
    pub why: String,
    /// Time of the approval, ms since 1970.
    pub unix_ms: i64,
}

impl RecipeOffer {
    /// Creates an offer of a recipe.
    ///
    /// # Errors
    /// If the name or the reason contains unprintable characters, or a text is too long.
    pub fn new(panel: &str, text: &str, (by, why): (&str, &str), unix_ms: i64) -> Result<Self, OfficeError> {
        let [panel, text, by, why] = [panel, text, by, why].map(str::to_owned);
        let offer = RecipeOffer { form: OFFER_FORMAT.to_owned(), panel, text, by, why, unix_ms };
        offer.validated()
    }

    fn validated(self) -> Result<Self, OfficeError> {
        for (what, text) in [("name", &self.by), ("reason", &self.why)] {
            panelprep_base::number_text::check_printable(text, MAX_TEXT_CHARACTERS).map_err(|problem| {
                OfficeError::form_error("offer of a recipe", format!("its {what}: {problem}"))
            })?;
        }
        match self.text.len() {
            0..MAX_OFFER_BYTES => Ok(self),
            found => {
                let [found, allowed] = [found, MAX_OFFER_BYTES].map(|count| format!("{count} bytes"));
                Err(OfficeError::Large { found, allowed })
            }
        }
    }

    /// Returns the SHA-256 of the recipe's text, as stated in records.
    pub fn hash(&self) -> String {
        content_hash(self.text.as_bytes())
    }

    /// Encodes the offer for sending.
    ///
    /// # Errors
    /// If JSON cannot represent the offer.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        serde_json::to_vec(self).map_err(|error| OfficeError::form_error("offer of a recipe", error))
    }

    /// Parses an offer.
    ///
    /// # Errors
    /// If the bytes are not a valid offer.
    pub fn read(bytes: &[u8]) -> Result<Self, OfficeError> {
        if bytes.len() > 2 * MAX_OFFER_BYTES {
            let [found, allowed] = [bytes.len(), 2 * MAX_OFFER_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let wrong = |problem: String| OfficeError::form_error("offer of a recipe", problem);
        let offer: RecipeOffer = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if offer.form != OFFER_FORMAT {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{OFFER_FORMAT}\"",
                offer.form.escape_debug()
            )));
        }
        offer.validated()
    }
}
