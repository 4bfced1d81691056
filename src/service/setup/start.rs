//! A requested start of a cycle, and the cycle with its files read and checked, which the loop can begin.

use super::cycle_setup::CycleSetup;
use super::recording::RecordingPlan;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle;
use panelprep_cell::record::PartNames;
use panelprep_store::store::CycleStart;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The request to start a cycle. It contains the recipe as text, so that an interface needs no file that the service
/// can read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartRequest {
    /// The recipe's name in messages.
    pub recipe: String,
    /// Its text.
    pub text: String,
    /// The destination of the cycle's recording; `None` if the cycle is not recorded.
    #[serde(default)]
    pub record: Option<RecordIn>,
    /// The part in the cell, with its work order and operator.
    #[serde(default)]
    pub part: Option<PartNames>,
    /// Whether a person states that the part in the fixture is not the part of the earlier cycles: its abrasions are
    /// then counted from zero.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub another_part: bool,
    /// The number of passes that the part had in cycles that a restored store lacks, as a person stated it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost_passes: Option<u8>,
    /// Whether the person stated on the operator's page that the guard is closed and no person is inside the cell. Only the
    /// page asks for it; a client's line cannot state it.
    #[serde(skip)]
    pub is_stated_clear: bool,
    /// Whether the text may differ from the file in the recipes' folder. The interface decides this by the person's
    /// role; a client's line cannot state it.
    #[serde(skip)]
    pub own_text: RecipeTextPermission,
}

/// Whether a start may contain a recipe text that is not in the recipes' folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RecipeTextPermission {
    /// Only a recipe of the folder is accepted: its name and content must agree.
    #[default]
    Refused,
    /// Any text is accepted; the record states that it is not from the folder.
    Allowed,
}

/// The destination of a cycle's recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordIn {
    /// In the store, under the cycle's number.
    Store,
    /// In this new file, given by its absolute path.
    File(PathBuf),
}

/// A cycle with its files read and checked; the loop can begin it.
#[derive(Debug)]
pub struct PreparedCycle {
    /// The request to the cycle's state table to begin the cycle.
    pub request: cycle::Request,
    /// Recipe, taught panel and calibrations.
    pub setup: CycleSetup,
    /// The data with which the cycle's record begins.
    pub start: CycleStart,
    /// How the cycle is recorded, if it is recorded.
    pub recording: Option<RecordingPlan>,
    /// Remarks on an accepted start, for the record.
    pub remarks: Vec<Reason>,
}

/// What a person states about earlier abrasions of the part, at a start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PassStatement {
    /// Whether the part in the fixture is not the part of the earlier cycles.
    pub another_part: bool,
    /// The number of passes that the part had in cycles that a restored store lacks, if it is stated.
    pub lost_passes: Option<u8>,
}
