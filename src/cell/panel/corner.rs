//! A taught corner: the pose of the flange camera, the pixel at which it saw the corner, and the corner's position
//! on the panel.
//!
//! Nominal camera pose and reference pixel are taught together (thesis 3.9). The corner's position on the panel is
//! the intersection of the reference pixel's ray with the plane of the surface beside it. From this position the
//! expected pixel follows for every camera pose, not only for the nominal one.

use super::error::LearnError;
use super::taught::TaughtPanel;
use panelprep_base::geometry::{FlangeCamera, Panel, PinholeCamera, Pixel, Point, Rigid, Vector};

/// Half the width of the neighbourhood that determines the surface beside a corner, px.
const NEIGHBOURHOOD_HALF_WIDTH_PX: usize = 12;
/// Largest distance between the ray and the outline, mm; the apex of a rounded corner lies a few mm outside the
/// outline.
const MAX_DISTANCE_MM: f64 = 15.0;

/// The data that a corner picture teaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerTeaching {
    /// The corner's pixel in the taught picture.
    pub reference_px: Pixel,
    /// The camera's pose, `wT_nominalCP` of the thesis.
    pub panel_from_camera: Rigid<Panel, FlangeCamera>,
}

/// A corner with its position on the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaughtCorner {
    /// The taught picture and outline of the corner.
    pub teaching_data: CornerTeaching,
    /// The corner: the intersection of its two edges, on the surface.
    pub point: Point<Panel>,
    /// The surface's normal beside the corner, a direction.
    pub normal: Vector<Panel>,
}

impl TaughtCorner {
    /// Returns the fraction, 0…1, of a motion along the panel's normal that the taught view shows as a sideways
    /// motion: the sine of the angle between the normal and the view.
    pub fn visible_normal_share(&self) -> f64 {
        let towards = (self.point - self.teaching_data.panel_from_camera.origin()).mm.normalize();
        towards.cross(&self.normal.mm).norm()
    }
}

impl TaughtPanel {
    /// Finds the position of a taught corner on the panel.
    ///
    /// # Errors
    /// If the distance between the reference pixel's ray and the panel's outline is larger than the rounding of a
    /// corner explains.
    pub fn corner(&self, teaching: CornerTeaching, camera: &PinholeCamera) -> Result<TaughtCorner, LearnError> {
        let Pixel { u, v } = teaching.reference_px;
        let off = LearnError::CornerOffPanel { u, v };
        let origin = teaching.panel_from_camera.origin();
        let ray =
            camera.unproject(teaching.reference_px).and_then(|ray| (teaching.panel_from_camera * ray).direction());
        let ray: Vector<Panel> = ray.ok_or_else(|| off.clone())?;
        let distance_mm = |point: &Point<Panel>| {
            let offset = (*point - origin).mm;
            (offset - ray.mm * offset.dot(&ray.mm)).norm()
        };
        let nearest = self
            .outline_px
            .iter()
            .filter_map(|pixel| Some((*pixel, self.outline_point_at(*pixel)?)))
            .min_by(|a, b| distance_mm(&a.1).total_cmp(&distance_mm(&b.1)))
            .filter(|(_, point)| distance_mm(point) <= MAX_DISTANCE_MM);
        let (pixel, _) = nearest.ok_or_else(|| off.clone())?;
        let at = (pixel.u as usize, pixel.v as usize);
        let plane = self.fit_plane_at(at, NEIGHBOURHOOD_HALF_WIDTH_PX).ok_or_else(|| off.clone())?;
        let point = plane.intersect_ray(origin, ray).ok_or(off)?;
        Ok(TaughtCorner { teaching_data: teaching, point, normal: plane.normal })
    }
}
