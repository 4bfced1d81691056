//! The tables of a recipe: every key with its range, default and meaning.

mod film;
mod panel;
mod path;
mod place;
mod removal;

pub use film::{Inspect, Method, Process, Region, SandedReference};
pub use panel::Panel;
pub use path::{FitMethod, Path, Pattern, Surface};
pub use place::{Corner, CornerName, CornerNames, Locate, Registration};
pub use removal::{Removal, RemovalMethod};

pub(super) use film::{take_inspect, take_process, take_region};
pub(super) use panel::take_panel;
pub(super) use path::take_path;
pub(super) use place::{take_corner, take_locate};
pub(super) use removal::take_removal;
