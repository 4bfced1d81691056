//! An acknowledgement: a person has seen an alarm. It changes neither the alarm nor the cell.

use panelprep_cell::record::CycleId;
use serde::{Deserialize, Serialize};

/// Records that a person has seen an alarm.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acknowledgement {
    /// Time at which the alarm was acknowledged, ms since 1970.
    pub unix_ms: i64,
    /// The cycle to which the alarm belongs; `None` for an alarm outside of a cycle.
    pub cycle: Option<CycleId>,
    /// The alarm's code, such as `low_overlap`.
    pub code: String,
    /// Time at which the alarm was raised, ms since 1970: the same code raised again is another alarm.
    pub raised_unix_ms: i64,
    /// The person who acknowledged it, as named at that time.
    pub who: String,
}
