//! The content of a simulated cell.

use clap::{Args, ValueEnum};
use panelprep_devices::acf::PlannedToolFault;

/// The scene that the simulated cell shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum SceneName {
    /// The right panel, displaced from its nominal pose, with greasy spots.
    #[default]
    Good,
    /// The right panel without grease.
    Clean,
    /// The fixture alone.
    NoPanel,
    /// Another panel.
    WrongPanel,
}

/// The content of a simulated cell; without effect on devices of another kind.
#[derive(Debug, Clone, Copy, Args)]
pub struct Simulation {
    /// Seed for all random values in the simulated cell.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The content of the simulated cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
    /// The number of the panel's displacement, for this seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub place: u32,
    /// Deviation of the simulated arm from its nominal geometry at the tool, rms, mm; 0 is an arm with its nominal
    /// geometry.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub arm_error_mm: f64,
    /// The simulated compliant tool fails during the path: NAME[=VALUE]@N, from the Nth waypoint in contact on, for
    /// example `silent@40`.
    #[arg(long, value_name = "FAULT")]
    pub tool_fault: Option<PlannedToolFault>,
    /// Number of parts that a simulated line brings to the simulated cell, with a request for a cycle for each;
    /// needs [line] in the cell's file.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub line_parts: u32,
}

impl Default for Simulation {
    fn default() -> Self {
        Simulation { seed: 1, scene: SceneName::Good, place: 0, arm_error_mm: 0.0, tool_fault: None, line_parts: 0 }
    }
}

/// Reads the deviation of the simulated arm from its nominal geometry, mm.
pub(super) fn arm_error(text: &str) -> Result<f64, String> {
    let allowed = || "the limits are 0 to 5 mm".to_owned();
    text.parse().ok().filter(|mm| (0.0..=5.0).contains(mm)).ok_or_else(allowed)
}
