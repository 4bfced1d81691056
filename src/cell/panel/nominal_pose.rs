//! The panel's frame at its nominal place.

use crate::recipe::Recipe;
use panelprep_base::geometry::{Base, Drawing, Panel, Rigid};

/// Returns the pose of the base in the frame of a panel taught by a scan: both frames are equal at teaching (thesis
/// 3.8). Used only by [`nominal_pose`] and by tests of such panels.
pub fn panel_from_base_at_teaching() -> Rigid<Panel, Base> {
    Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity())
}

/// Returns the panel's nominal pose. If the panel is taught from its drawing, this is the pose of the drawing's frame,
/// which is also the base set in the controller; otherwise it is the base.
pub fn nominal_pose(recipe: &Recipe) -> Rigid<Base, Panel> {
    // The only place that declares the panel's frame to be the drawing's frame.
    let of_drawing =
        |base_from_drawing: Rigid<Base, Drawing>| Rigid::from_isometry_unchecked(*base_from_drawing.isometry());
    let scanned = || panel_from_base_at_teaching().inverse();
    recipe.nominal().map_or_else(scanned, |nominal| of_drawing(nominal.base_from_drawing()))
}
