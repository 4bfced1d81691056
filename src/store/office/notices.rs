//! The messages between cell and office that have no number, because the next one replaces them.
//!
//! A cell reports its state to the office repeatedly. A report may be lost, because the next one follows soon. The
//! office offers to its cells a recipe that it has approved. A cell never adopts a recipe automatically: a person at
//! the cell checks the difference and approves it like any other change.

use super::message::{OfficeError, Position};
use panelprep_cell::cell::CellName;
use panelprep_cell::files::content_hash;
use serde::{Deserialize, Serialize};

const STATE_FORM: &str = "panelprep-state-1";
/// Longest message, bytes.
const MAX_STATE_BYTES: usize = 64 * 1024;

/// The state of a cell.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellState {
    form: String,
    cell: String,
    /// The cell's clock, ms since 1970.
    pub unix_ms: i64,
    /// The program's version.
    pub version: String,
    /// The keyword of the state; `None` if the loop does not answer.
    pub state: Option<String>,
    /// The current phase of the running cycle.
    pub phase: Option<String>,
    /// The panel.
    pub panel: Option<String>,
    /// The cycle.
    pub cycle: Option<i64>,
    /// Progress along the path: the current waypoint and the number of waypoints.
    pub waypoint: Option<[u32; 2]>,
    /// The reasons for its state: codes and messages.
    pub reasons: Vec<ReasonText>,
    /// Problems of the cell between cycles, such as a full disk or a calibration that expires.
    pub standing: Vec<ReasonText>,
    /// For each epoch, the number of the cell's last item for the office.
    pub last: Vec<Position>,
}

/// A reason in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReasonText {
    /// Its code.
    pub code: String,
    /// Message of the reason.
    pub message: String,
}

impl CellState {
    /// Returns the state of this cell, with nothing reported yet.
    pub fn new(cell: &CellName) -> Self {
        CellState { form: STATE_FORM.to_owned(), cell: cell.as_str().to_owned(), ..CellState::default() }
    }

    /// Returns the bytes to send.
    ///
    /// # Errors
    /// If JSON cannot represent the state.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        serde_json::to_vec(self).map_err(|error| OfficeError::form_error("state of a cell", error))
    }

    /// Reads a state and the name of its cell.
    ///
    /// # Errors
    /// If the bytes are not a state.
    pub fn read(bytes: &[u8]) -> Result<(CellName, Self), OfficeError> {
        let wrong = |problem: String| OfficeError::form_error("state of a cell", problem);
        if bytes.len() > MAX_STATE_BYTES {
            let [found, allowed] = [bytes.len(), MAX_STATE_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let state: CellState = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if state.form != STATE_FORM {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{STATE_FORM}\"",
                state.form.escape_debug()
            )));
        }
        Ok((CellName::new(&state.cell).map_err(wrong)?, state))
    }
}

const OFFER_FORM: &str = "panelprep-offer-1";
/// Longest offer, bytes.
const MAX_OFFER_BYTES: usize = 256 * 1_024;
/// Maximum number of characters of a name or a reason.
const MAX_CHARACTERS: usize = 200;

/// A recipe that the office offers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecipeOffer {
    form: String,
    /// The panel to which the recipe belongs.
    pub panel: String,
    /// Its text.
    pub text: String,
    /// The printed name of the person who approved it in the office.
    pub by: String,
    /// Reason of the change, as the person stated it.
    pub why: String,
    /// Time of the approval, ms since 1970.
    pub unix_ms: i64,
}

impl RecipeOffer {
    /// Creates an offer of this recipe.
    ///
    /// # Errors
    /// If the name or the reason cannot be printed unchanged, or the text is too long.
    pub fn new(panel: &str, text: &str, (by, why): (&str, &str), unix_ms: i64) -> Result<Self, OfficeError> {
        let [panel, text, by, why] = [panel, text, by, why].map(str::to_owned);
        let offer = RecipeOffer { form: OFFER_FORM.to_owned(), panel, text, by, why, unix_ms };
        offer.validated()
    }

    fn validated(self) -> Result<Self, OfficeError> {
        for (what, text) in [("name", &self.by), ("reason", &self.why)] {
            panelprep_base::number_text::printable(text, MAX_CHARACTERS).map_err(|problem| {
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

    /// Returns the SHA-256 of the recipe's text, as records state it.
    pub fn hash(&self) -> String {
        content_hash(self.text.as_bytes())
    }

    /// Returns the bytes to send.
    ///
    /// # Errors
    /// If JSON cannot represent the offer.
    pub fn bytes(&self) -> Result<Vec<u8>, OfficeError> {
        serde_json::to_vec(self).map_err(|error| OfficeError::form_error("offer of a recipe", error))
    }

    /// Reads an offer.
    ///
    /// # Errors
    /// If the bytes are not an offer.
    pub fn read(bytes: &[u8]) -> Result<Self, OfficeError> {
        if bytes.len() > 2 * MAX_OFFER_BYTES {
            let [found, allowed] = [bytes.len(), 2 * MAX_OFFER_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let wrong = |problem: String| OfficeError::form_error("offer of a recipe", problem);
        let offer: RecipeOffer = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if offer.form != OFFER_FORM {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{OFFER_FORM}\"",
                offer.form.escape_debug()
            )));
        }
        offer.validated()
    }
}
