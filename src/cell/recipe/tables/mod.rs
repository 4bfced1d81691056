//! The tables of a recipe: every key with its range, default and meaning.

mod film;
mod nominal;
mod panel;
mod path;
mod place;
mod removal;
mod treat;

pub use film::{Inspect, Method, Process, Region, SandedReference};
pub use nominal::DrawingPlacement;
pub use panel::Panel;
pub use path::{FitMethod, Path, Pattern, Surface};
pub use place::{Corner, CornerName, CornerNames, Locate, Registration};
pub use removal::{Removal, RemovalMethod};
pub use treat::{Treat, TreatBy};

pub(super) use film::{parse_inspect, parse_process, parse_region};
pub(super) use nominal::parse_nominal;
pub(super) use panel::parse_panel;
pub(super) use path::parse_path;
pub(super) use place::{parse_corner, parse_locate};
pub(super) use removal::parse_removal;
pub(super) use treat::parse_treat;
