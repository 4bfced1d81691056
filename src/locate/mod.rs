//! Where the panel stands: 3D registration of a scan (thesis 3.8) and its correction by a corner (thesis 3.9).
//!
//! The scan, moved to the base, is cut to the search box; the connected piece of the panel's size is the panel. Taught
//! and scanned centroids laid upon each other are the start. Point-to-point ICP (Eq. 3.20, 3.21) brings the taught
//! panel near, point-to-plane with the outline brings it home. The result is evidence, a [`Fit`]; [`gate`] judges it.
//! [`corner`] finds the panel's corner in a picture of the flange camera, [`refine`] moves the pose by what it says.
//! Does not search from any placement: the panel may stand some 60 mm and 15° from its nominal place.

pub mod corner;
mod correspond;
mod error;
mod evidence;
pub mod gate;
mod piece;
mod point_to_plane;
mod point_to_point;
pub mod refine;
mod samples;

pub use error::LocateError;
pub use evidence::Fit;
pub use refine::refine;

use crate::geometry::{Base, Camera, OrganizedCloud, Panel, Rigid};
use crate::panel::{TaughtPanel, panel_from_base_at_teaching};
use crate::recipe;

/// Finds the taught panel in a scan.
///
/// # Errors
/// Where nothing of the panel's size and shape lies in the search box; [`gate::refusal`] makes it a verdict.
pub fn locate(
    taught: &TaughtPanel,
    scan: &OrganizedCloud<Camera>,
    base_from_camera: Rigid<Base, Camera>,
    settings: &recipe::Locate,
) -> Result<Fit, LocateError> {
    let scan = scan.moved(&base_from_camera);
    let size = piece::Size::of(&taught.scan, &taught.mask).ok_or(LocateError::EmptyBox { found: 0, needed: 1 })?;
    let (mask, piece_size) = piece::find(&scan, &size, settings)?;
    let samples = samples::Taught::of(taught, size.area_mm2)?;
    let scanned = samples::Scanned::of(&scan, &mask, piece_size.area_mm2, base_from_camera.origin())?;
    let start = centroids_together(&samples, &scanned);
    let near = point_to_point::align(start, &samples, &scanned);
    let aligned = point_to_plane::align(near, &samples, &scanned, size.area_mm2)?;
    evidence::weigh(aligned, taught, &samples, &scanned, size.area_mm2)
}

/// The taught panel, not turned, with its middle where the scan's piece has its own.
fn centroids_together(taught: &samples::Taught, scanned: &samples::Scanned) -> Rigid<Base, Panel> {
    let nominal = panel_from_base_at_teaching().inverse();
    nominal.displaced(scanned.centre() - nominal * taught.centre)
}
