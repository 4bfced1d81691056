//! The state of a cell, which it reports to the office repeatedly. A report may be lost, because the next one follows
//! soon.

use super::error::OfficeError;
use super::position::Position;
use panelprep_cell::cell::CellName;
use serde::{Deserialize, Serialize};

const FORM: &str = "panelprep-state-1";
/// Longest message, bytes.
const MAX_BYTES: usize = 64 * 1024;

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
    /// Problems of the cell between cycles: a disk, a calibration that expires.
    pub standing: Vec<ReasonText>,
    /// For each epoch, the last number that the cell has for the office.
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
        CellState { form: FORM.to_owned(), cell: cell.as_str().to_owned(), ..CellState::default() }
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
        if bytes.len() > MAX_BYTES {
            let [found, allowed] = [bytes.len(), MAX_BYTES].map(|count| format!("{count} bytes"));
            return Err(OfficeError::Large { found, allowed });
        }
        let state: CellState = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if state.form != FORM {
            return Err(wrong(format!(
                "the field \"form\" is \"{}\", expected \"{FORM}\"",
                state.form.escape_debug()
            )));
        }
        Ok((CellName::new(&state.cell).map_err(wrong)?, state))
    }
}
