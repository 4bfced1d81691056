//! The set-up of a cell, below the loop: the cell's file with its calibrations, recipes with the taught data of their
//! panels, and the records and pages of its cycles.
//!
//! ```text
//! cell_files ── teaching ── cycle_files ── start          a cycle with its files read and checked
//!     └── pages                                           what a cycle leaves: its page, its signed record
//! ```
//!
//! `cell_files` reads the cell's file and, when they are needed, its calibrations; `cameras` the settings of the 3D
//! camera. `teaching` derives a panel from its taught data, and `identify` compares a scan with all panels.
//! `cycle_files` combines both with a recipe and the `part`; `health` judges by the last verifications whether a cycle
//! may start. The result is the loop's input: `cycle_setup`, with the `wiring` of the outputs and the `proof_gate` of the
//! controller. `recording` and `recorded_cycle` are the files of recordings. Every error is a [`SetupFault`].

pub mod cameras;
mod cell_files;
pub mod clock;
mod cycle_files;
mod cycle_loader;
mod cycle_setup;
pub mod disk;
mod fault;
mod health;
mod identify;
mod pages;
mod part;
pub(crate) mod proof_gate;
mod recipes;
mod recorded_cycle;
mod recording;
mod start;
mod teaching;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod testing;
mod wiring;

pub use cell_files::{CellFiles, CellPaths, LoadedCalibration, Mounted, NO_AXES, last_touch_check};
pub use cycle_files::{Calibrated, TaughtRecipe};
pub use cycle_loader::{CycleLoader, unreadable_reason};
pub use cycle_setup::{Calibrations, CellSetup, CycleSetup};
pub use fault::SetupFault;
pub use health::{Equipment, EquipmentList, expiring_verifications, force_hash, force_verification, judge_health};
pub use identify::{AlikePanels, PanelProposal, ProposalLimits, UnusablePanel, find_alike_panels, propose};
pub use pages::{
    RecordPdf, StoredCycle, cycle_html, cycle_pdf, key, make_missing_pages, page_file, recording_status,
    sign_by_person, sign_missing, signed_pdf,
};
pub use part::parse_part_names;
pub use proof_gate::ProofGate;
pub use recipes::{RecipeText, parse_recipe_for_cell, read_recipe, recipe_problems};
pub use recorded_cycle::{RecordedCycle, plan_recording};
pub use recording::{
    MIN_FREE_SPACE_FOR_RECORDING_MB, MIN_FREE_SPACE_MB, RecordingPlan, RecordingResult, RecordingStatus,
    check_client_file, check_command_file, check_recording_file, disk_full_message, free_mb, open_refusal,
    recording_file, recordings,
};
pub use start::{PassStatement, PreparedCycle, RecipeTextPermission, RecordIn, StartRequest};
pub use teaching::{LoadedPanel, derive, taught, teaching_of};
pub use wiring::Wiring;
pub(crate) use wiring::{
    DeviceReading, FeedbackContradiction, RINSE_OUTPUT_NAME, SwitchProof, contrary_reason, is_input_on,
    unproven_reason,
};
