//! The switches of the cell. The cell's file assigns the outputs and feedbacks to them.

use serde::{Deserialize, Serialize};

/// An output and its commanded state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Switch {
    ToolOn,
    ToolOff,
    Rinse,
    Spray,
    WaterOff,
    LightOn,
    LightOff,
    /// The lens shutters are open: cameras can see.
    LensClear,
    /// The lens guard is shut or purged: no drop reaches a lens.
    LensGuard,
    /// The extraction is on and proven by its flow.
    ExtractionOn,
    ExtractionOff,
}
