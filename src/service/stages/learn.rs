//! Teaches a corner of a panel from a picture of the flange camera at the panel's nominal place. [`TaughtPanel::learn`]
//! teaches the panel itself.

use panelprep_base::geometry::{Base, ColorPicture, Flange, FlangeCamera, PinholeCamera, Point, Rigid};
use panelprep_cell::panel::{CornerTeaching, LearnError, TaughtCorner, TaughtPanel};
use panelprep_cell::recipe;
use panelprep_vision::locate::corner::{self, CornerError};

/// The reason why a corner could not be taught.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CornerLearnError {
    /// The picture shows no corner.
    #[error(transparent)]
    NotFound(#[from] CornerError),
    /// The corner is not on the taught panel.
    #[error(transparent)]
    NotOnPanel(#[from] LearnError),
}

/// Teaches the corner with this number, from 0, from a picture captured at the pose `base_from_flange`.
///
/// # Errors
/// If the picture shows no corner of the panel.
pub fn teach_corner(
    panel: &TaughtPanel,
    (settings, number): (&recipe::Corner, usize),
    (picture, base_from_flange): (&ColorPicture, Rigid<Base, Flange>),
    (camera, flange_from_camera): (&PinholeCamera, Rigid<Flange, FlangeCamera>),
) -> Result<TaughtCorner, CornerLearnError> {
    let panel_from_camera = panel.nominal_pose.inverse() * base_from_flange * flange_from_camera;
    let gray = picture.to_gray();
    let seen_at = |scale_from: Point<_>| -> Result<TaughtCorner, CornerLearnError> {
        let expected = panel_from_camera.inverse() * scale_from;
        let reference_px = corner::find_taught(&gray, (settings, number), camera, expected)?.corner_px;
        Ok(panel.corner(CornerTeaching { reference_px, panel_from_camera }, camera)?)
    };
    // First the corner is detected with the picture's scale at the panel's centre, which gives its place. Then it is
    // detected again with the scale at this place, as in a cycle: the ends of the edges depend on the scale, and so
    // does their intersection, by a tenth of a pixel.
    let rough = seen_at(panel.centre())?;
    seen_at(rough.point)
}
