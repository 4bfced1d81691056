//! The panel's corner in a picture of the flange camera (thesis 3.9, Fig. 3.17).
//!
//! As in the thesis: bilateral filter (Fig. 3.18), threshold (Fig. 3.19), the largest contour, the smallest box around
//! it (Fig. 3.20), and the contour's point nearest to the box's corner (Fig. 3.21). Two details differ from the
//! thesis. First, a direction states which corner of the box is meant, since the order of `minAreaRect`'s corners
//! jumps as the box turns. Second, the reported point is the intersection of the two extended edges beside that
//! contour point: a single pixel on a rounded corner is a poor measurement, two lines through hundreds of sub-pixel
//! points are a good one (see `edge`). Lens distortion and the panel's curvature bend the edges by a fraction of a
//! pixel over the fitted length. The edges of the taught and the found corner are bent alike, because they are seen
//! from nearly the same position; this is not corrected. This module does not know the expected place of the corner:
//! see `refine`.

mod edge;
mod error;

pub use edge::EdgeLine;
pub use error::CornerError;

use panelprep_base::geometry::{FlangeCamera, GrayPicture, Mask, PinholeCamera, Pixel, Point, polygon};
use panelprep_cell::imaging::{bilateral_filter, min_area_box, outer_contours};
use panelprep_cell::recipe::{self, CornerName};

/// A contour that encloses less than this fraction of the picture is not the panel.
const MIN_PICTURE_SHARE: f64 = 0.02;
/// Contour points within this distance of the picture's border are caused by the border, px.
const BORDER_PX: f64 = 3.0;
/// Edges that meet at a smaller angle do not determine the corner, degrees.
const MIN_ANGLE_DEG: f64 = 20.0;

/// A corner, with the intermediate results of its detection.
#[derive(Debug, Clone, PartialEq)]
pub struct CornerFound {
    /// The intersection of the two edges.
    pub corner_px: Pixel,
    /// The contour point nearest to the box's corner, which the thesis uses as the corner.
    pub nearest_px: Pixel,
    /// The panel's contour, pixel by pixel.
    pub contour: Vec<Pixel>,
    /// The corners of the smallest box around the contour.
    pub box_px: [Pixel; 4],
    /// The two edges.
    pub edges: [EdgeLine; 2],
}

/// Finds the panel's corner that lies in this direction. `px_per_mm` is the picture's scale at the corner, focal
/// length over depth.
///
/// # Errors
/// If the picture shows no corner of the panel; each error states the remedy.
pub fn find(
    picture: &GrayPicture,
    settings: &recipe::Corner,
    which: CornerName,
    px_per_mm: f64,
) -> Result<CornerFound, CornerError> {
    // The filter keeps edges. The edges themselves are fitted on the unfiltered picture below, since a filter moves
    // them by fractions of a pixel.
    let filtered = bilateral_filter(picture, settings.bilateral_diameter_px(), settings.bilateral_sigma_gray())?;
    let contour = panel_contour(&filtered, settings)?;
    let box_px = min_area_box(&contour)?;
    let nearest = nearest_contour_index(&contour, meant_corner(&box_px, which));
    let nearest_px = contour[nearest];
    let inside = |pixel: Pixel| {
        let (right, bottom) = (picture.width as f64 - 1.0, picture.height as f64 - 1.0);
        pixel.u.min(pixel.v).min(right - pixel.u).min(bottom - pixel.v) > BORDER_PX
    };
    if !inside(nearest_px) {
        return Err(CornerError::CornerAtBorder { u: nearest_px.u, v: nearest_px.v });
    }
    let length =
        edge::EdgeStretch { skip_px: settings.rounding_mm() * px_per_mm, fit_px: settings.edge_mm() * px_per_mm };
    let fitted = |start: usize, step: isize| {
        let along =
            walk_contour(&contour, start, step).take_while(|&(_, way_px)| way_px <= length.skip_px + length.fit_px);
        // Points on the picture's border follow the border and not the panel.
        let beside = along.filter(|&(pixel, way_px)| way_px >= length.skip_px && inside(pixel));
        edge::fit(picture, &beside.map(|(pixel, _)| pixel).collect::<Vec<_>>(), length)
    };
    let edges_from =
        |start: usize| -> Result<[EdgeLine; 2], CornerError> { Ok([fitted(start, 1)?, fitted(start, -1)?]) };
    // In a turned picture the thesis's corner point does not lie in the middle of the rounding: a first intersection
    // of the edges shows where the middle is.
    let rough = edges_from(nearest)?;
    let rough_px = edge::intersect_edges(&rough[0], &rough[1], MIN_ANGLE_DEG)?;
    let edges = edges_from(nearest_contour_index(&contour, rough_px))?;
    let corner_px = edge::intersect_edges(&edges[0], &edges[1], MIN_ANGLE_DEG)?;
    if !inside(corner_px) {
        return Err(CornerError::CornerAtBorder { u: corner_px.u, v: corner_px.v });
    }
    Ok(CornerFound { corner_px, nearest_px, contour, box_px, edges })
}

/// Finds the taught corner with this number, counted from 0. `expected` is its expected position in the camera
/// frame; its distance gives the scale.
///
/// # Errors
/// As [`find`].
pub fn find_taught(
    picture: &GrayPicture,
    (settings, corner): (&recipe::Corner, usize),
    camera: &PinholeCamera,
    expected: Point<FlangeCamera>,
) -> Result<CornerFound, CornerError> {
    find(picture, settings, settings.which().for_picture(corner), camera.px_per_mm_at(expected.mm.z).0)
}

fn panel_contour(filtered: &GrayPicture, settings: &recipe::Corner) -> Result<Vec<Pixel>, CornerError> {
    let (min, max) = (settings.panel_gray_min(), settings.panel_gray_max());
    let inside = filtered.gray.iter().map(|&gray| (min..=max).contains(&usize::from(gray))).collect();
    let mask = Mask { width: filtered.width, height: filtered.height, inside };
    // The largest contour: smaller ones are reflections and labels with the panel's grey levels.
    let contour = outer_contours(&mask)?.into_iter().next().ok_or(CornerError::NoContour { min, max })?;
    let share = polygon::signed_area_px2(&contour).abs() / (mask.width * mask.height) as f64;
    if share < MIN_PICTURE_SHARE {
        let (found_percent, needed_percent) = (100.0 * share, 100.0 * MIN_PICTURE_SHARE);
        return Err(CornerError::ContourTooSmall { found_percent, needed_percent });
    }
    Ok(contour)
}

/// Returns the corner of the box that lies farthest in the taught direction; correct for boxes turned by up to 45°.
fn meant_corner(box_px: &[Pixel; 4], which: CornerName) -> Pixel {
    let (right, down) = match which {
        CornerName::TopLeft => (-1.0, -1.0),
        CornerName::TopRight => (1.0, -1.0),
        CornerName::BottomRight => (1.0, 1.0),
        CornerName::BottomLeft => (-1.0, 1.0),
    };
    let far = |pixel: &Pixel| right * pixel.u + down * pixel.v;
    box_px.iter().copied().fold(box_px[0], |best, corner| if far(&corner) > far(&best) { corner } else { best })
}

fn nearest_contour_index(contour: &[Pixel], corner: Pixel) -> usize {
    let distance = |index: &usize| contour[*index].distance_px(corner);
    (0..contour.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or_default()
}

/// Walks once around the contour from one of its points, forwards (`step` 1) or backwards (−1). Returns each point
/// with the distance travelled, px.
fn walk_contour(contour: &[Pixel], start: usize, step: isize) -> impl Iterator<Item = (Pixel, f64)> + '_ {
    let count = contour.len() as isize;
    let at = move |i: isize| contour[(start as isize + i * step).rem_euclid(count) as usize];
    (0..count).scan(0.0, move |way_px, i| {
        *way_px += if i == 0 { 0.0 } else { at(i).distance_px(at(i - 1)) };
        Some((at(i), *way_px))
    })
}

#[cfg(test)]
mod tests;
