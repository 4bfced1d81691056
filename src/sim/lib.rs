//! The simulated cell: panel, fixture, both cameras and the water film, rendered from one seed, with ground truth.
//!
//! Pure functions from seed and scene to data: no files, no clock. This crate uses only `geometry` and shares no other
//! code with the code under test. The panel's frame coincides with the base at the nominal pose (thesis 3.8).
//!
//! - `shape`: the panel as a height field with an outline, and as a mesh
//! - `scene`: the poses of all objects, and the fixture
//! - `cast`: the surface that each pixel sees · `appearance`: its colour · `noise`: random numbers
//! - `variety`, `trial`: panels of many shapes among other objects, for the localization
//! - `board`: calibration boards in front of both cameras
//! - `real_arm`: an arm that differs from its nominal geometry
//! - `cell`: the whole cell
//! - `scanner`, `appearance`, `film`, `wetting`, `sanding`: the cameras' data · `film_spec`: the difficulty of films ·
//!   `film_defects`: grease · `truth`: the ground truth
//!
//! Not simulated: focus, the arm in the picture, glints and drops on the fixture.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
// Every result is handled, or an `expect` attribute next to it states why it is ignored.
#![cfg_attr(not(test), deny(clippy::let_underscore_must_use))]
// `println!` and similar macros panic if nothing reads the output: see `cli::output`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

mod appearance;
mod board;
mod cast;
mod cell;
mod film;
mod film_defects;
mod film_spec;
mod noise;
mod real_arm;
mod sanding;
mod scanner;
mod scene;
mod shape;
mod trial;
mod truth;
mod variety;
mod wetting;

pub use board::{BoardCell, BoardPrint, BoardShot, Marker, RobotNoise};
pub use cell::{Cell, PanelPosition, Region, SEARCH_BOX_MM, Target};
pub use film::Film;
pub use film_defects::{Grease, GreasySpot, SpotKind};
pub use film_spec::FilmSpec;
pub use real_arm::{RealArm, ReportedFlangePose, TOOL_LENGTH_MM};
pub use sanding::{Sanding, SandingStrength};
pub use scanner::{NoiseFigures, ScannerDistortion, scanner_noise};
pub use scene::{CornerView, Scene};
pub use shape::PanelBend;
pub use trial::{SceneDefect, TRIAL_BOX_MM, TrialScene};
pub use truth::{CellTruth, CornerNumbers, PlacementError, SpotNumbers, TrueSpot, TruthNumbers};
pub use variety::PanelVariant;
pub use wetting::{Phase, SPRAY_FROM_S, WET_FROM_S};
