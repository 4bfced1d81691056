//! What is switched. Which outputs and feedbacks that are is the cell's matter.

use serde::{Deserialize, Serialize};

/// An output and what it should be.
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
    /// Cameras can see.
    LensClear,
    /// Shut or purged: no drop reaches a lens.
    LensGuard,
    /// On and proven by its flow.
    ExtractionOn,
    ExtractionOff,
}
