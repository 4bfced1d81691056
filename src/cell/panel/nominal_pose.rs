//! The panel's frame at its nominal place.

use crate::recipe::Recipe;
use panelprep_base::geometry::{Base, Drawing, Panel, Rigid};

/// Declares that at teaching the frame of a scanned panel is the base (thesis 3.8). Only [`nominal_pose`] uses it, and
/// tests of scanned panels.
pub fn panel_from_base_at_teaching() -> Rigid<Panel, Base> {
    Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity())
}

/// Returns the panel's frame at its nominal place: the drawing's frame if the panel is taught from its drawing, so that
/// the base in the controller is the drawing's, and otherwise the base.
pub fn nominal_pose(recipe: &Recipe) -> Rigid<Base, Panel> {
    // The only declaration that the panel's frame is the drawing's.
    let of_drawing =
        |base_from_drawing: Rigid<Base, Drawing>| Rigid::from_isometry_unchecked(*base_from_drawing.isometry());
    let scanned = || panel_from_base_at_teaching().inverse();
    recipe.nominal().map_or_else(scanned, |nominal| of_drawing(nominal.base_from_drawing()))
}
