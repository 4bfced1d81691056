//! The quality of a shot, in numbers on which a person can act: sharpness, saturation, darkness, missing points.
//!
//! Sharpness is the steepness of edges: the gradient of grey levels, √(gᵤ² + gᵥ²) by central differences, at the
//! steepest thousandth of the pixels. It increases as the picture comes into focus and depends on the scene. It can
//! therefore compare two focus settings for the same scene, but it cannot judge one setting alone.

use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud};

/// A channel at or above this level is saturated.
const SATURATED: u8 = 254;
/// A pixel is dark if its brightest channel is below this level.
const DARK: u8 = 10;
/// The steepest pixels.
const STEEPEST_SHARE: f64 = 0.001;

/// The quality of a picture, from its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureQuality {
    /// Gradient at the steepest thousandth of the pixels, grey levels per pixel.
    pub sharpness_gray_per_px: f64,
    /// Share of pixels with a saturated channel.
    pub saturated_share: f64,
    /// Share of dark pixels.
    pub dark_share: f64,
    /// Mean grey level.
    pub mean_gray: f64,
}

impl PictureQuality {
    /// Returns the quality of a picture; all zero if it has no inner pixel.
    pub fn compute(picture: &ColorPicture) -> Self {
        let gray = picture.to_gray();
        let (width, height) = (gray.width, gray.height);
        let at = |column: usize, row: usize| f64::from(gray.gray[row * width + column]);
        let mut slopes = Vec::new();
        for row in 1..height.saturating_sub(1) {
            for column in 1..width.saturating_sub(1) {
                let (du, dv) =
                    (at(column + 1, row) - at(column - 1, row), at(column, row + 1) - at(column, row - 1));
                slopes.push(du.hypot(dv) / 2.0);
            }
        }
        let pixels = picture.rgb.len().max(1) as f64;
        let share = |is_one: &dyn Fn(&[u8; 3]) -> bool| {
            picture.rgb.iter().filter(|rgb| is_one(rgb)).count() as f64 / pixels
        };
        PictureQuality {
            sharpness_gray_per_px: quantile(&mut slopes, 1.0 - STEEPEST_SHARE).unwrap_or(0.0),
            saturated_share: share(&|rgb| rgb.iter().any(|level| *level >= SATURATED)),
            dark_share: share(&|rgb| rgb.iter().all(|level| *level < DARK)),
            mean_gray: gray.gray.iter().map(|level| f64::from(*level)).sum::<f64>() / pixels,
        }
    }
}

/// The quality of a scan, from its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanQuality {
    /// Number of pixels that have a point.
    pub points: usize,
    /// Share of pixels without a point.
    pub missing_share: f64,
    /// Distances along the camera's axis below which 5, 50 and 95 % of the points lie, mm; `None` without points.
    pub depth_mm: Option<[f64; 3]>,
}

impl ScanQuality {
    /// Computes the quality of a scan.
    pub fn compute(cloud: &OrganizedCloud<Camera>) -> Self {
        let mut depths: Vec<f64> = cloud.valid_points().map(|(_, point)| point.mm.z).collect();
        let points = depths.len();
        let pixels = (cloud.width() * cloud.height()).max(1);
        let mut at = |share: f64| quantile(&mut depths, share);
        let depth_mm = match (at(0.05), at(0.5), at(0.95)) {
            (Some(near), Some(middle), Some(far)) => Some([near, middle, far]),
            _ => None,
        };
        ScanQuality { points, missing_share: 1.0 - points as f64 / pixels as f64, depth_mm }
    }
}

/// Returns the quantile of these values for this fraction; `None` if there are no values.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let index = ((values.len() as f64 * share) as usize).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(index, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: a vertical edge from 40 to 200 has a slope of 80 grey levels a pixel in two columns of
    /// twenty; blurred over four pixels it has 40. A tenth of the pixels is saturated, another tenth dark.
    #[test]
    fn an_edge_is_as_steep_as_it_is_sharp() {
        let picture = |levels: [u8; 20]| {
            let mut picture = ColorPicture::uniform(20, 10, [0; 3]);
            picture.rgb.iter_mut().enumerate().for_each(|(index, rgb)| *rgb = [levels[index % 20]; 3]);
            picture
        };
        let mut levels = [40; 20];
        levels[10..].fill(200);
        let sharp = PictureQuality::compute(&picture(levels));
        assert!((sharp.sharpness_gray_per_px - 80.0).abs() < 1.0 && sharp.saturated_share == 0.0, "{sharp:?}");
        (levels[9], levels[10]) = (80, 160);
        (levels[8], levels[11]) = (40, 200);
        let soft = PictureQuality::compute(&picture(levels));
        assert!(soft.sharpness_gray_per_px < 65.0, "{soft:?}");
        (levels[0], levels[1], levels[18], levels[19]) = (5, 5, 255, 255);
        let clipped = PictureQuality::compute(&picture(levels));
        assert_eq!((clipped.saturated_share, clipped.dark_share), (0.1, 0.1));
    }

    /// Calculated by hand: two of six pixels have no point.
    #[test]
    fn missing_points_are_counted() {
        let nan = [f32::NAN; 3];
        let points = vec![[0.0, 0.0, 500.0], nan, [1.0, 0.0, 600.0], [0.0, 1.0, 700.0], nan, [1.0, 1.0, 800.0]];
        let cloud = OrganizedCloud::<Camera>::new(3, 2, points, vec![[9; 3]; 6]).expect("six pixels");
        let found = ScanQuality::compute(&cloud);
        assert_eq!(found.points, 4);
        assert!((found.missing_share - 2.0 / 6.0).abs() < 1e-12 && found.depth_mm.is_some(), "{found:?}");
    }
}
