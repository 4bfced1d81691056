//! The 3D camera's own errors, measured with a flat board at many positions in the working volume.
//!
//! A plane in front of the camera is linear in the directions (x, y) = (X/Z, Y/Z): 1/z = a + b x + c y. The remainder
//! of a scan of a flat board is the camera's error, in five parts:
//! - white noise, from pixel to pixel, which grows with z²;
//! - the error that is the same in each scan (`field`): a correction, kept only if it predicts scans that were left
//!   out;
//! - the smooth error that differs from scan to scan (`spread`): its size and the length over which it is
//!   correlated, from means over parts of the board, since a plane through the board absorbs a part;
//! - the board's own bow, which rotates with the board and can therefore be distinguished;
//! - scale: distances between corners, as measured and as printed; from scan to scan the part that the smooth error
//!   does not explain. If distances are longer on one side of the picture, planes are turned into other planes
//!   (`tilt`), which is corrected, too.
//!
//! Not measured: lenses (`intrinsics`).

mod block;
mod field;
mod found;
mod gate;
mod parts;
mod plane;
mod plane_view;
mod spread;
mod tilt;

#[cfg(test)]
mod tests;

pub use block::Block;
pub use found::ScannerErrors;
pub use gate::{MIN_BOARD_POSITIONS, checks};
pub use parts::{MIN_SCANS, PicturePart, PictureParts};
pub use plane_view::{BoardScan, PlaneView};

use super::error::CalibError;
use field::ProjectedScan;
use panelprep_base::geometry::{Camera, DepthField, FieldRectangle, PinholeCamera, Pixel};

/// Returns the directions of a camera's whole picture; `None` if its corners have no ray.
pub fn direction_rectangle(camera: &PinholeCamera) -> Option<FieldRectangle> {
    let [right, low] = [camera.width_px, camera.height_px].map(|count| count as f64 - 1.0);
    let corners = [[0.0, 0.0], [right, 0.0], [0.0, low], [right, low]];
    let rays = corners.map(|[u, v]| camera.unproject::<Camera>(Pixel::at(u, v)));
    let mut over = FieldRectangle { min: [f64::INFINITY; 2], max: [f64::NEG_INFINITY; 2] };
    for ray in rays {
        let ray = ray?.mm;
        for (axis, at) in [ray.x / ray.z, ray.y / ray.z].into_iter().enumerate() {
            over.min[axis] = over.min[axis].min(at);
            over.max[axis] = over.max[axis].max(at);
        }
    }
    Some(over)
}

/// The error that is the same in each scan is corrected only if the left-out rms falls to this share.
const MAX_RMS_RATIO: f64 = 0.9;

/// Measures the camera's errors.
///
/// # Errors
/// If fewer scans than [`MIN_BOARD_POSITIONS`] show the board, or boards fill no part of the picture.
pub fn measure(views: &[PlaneView], over: FieldRectangle) -> Result<ScannerErrors, CalibError> {
    if views.len() < MIN_BOARD_POSITIONS {
        let message = format!(
            "{} scans show the whole board, flat; at least {MIN_BOARD_POSITIONS} are needed, at different places of the \
             working volume",
            views.len()
        );
        return Err(CalibError::Points(message));
    }
    let none = || CalibError::Points("the boards in the scans have too few points for a fit".to_owned());
    let fits: Vec<ProjectedScan> =
        views.iter().map(|view| ProjectedScan::from_view(view, &over)).collect::<Option<_>>().ok_or_else(none)?;
    let plain = field::cross_validate(&fits, None).ok_or_else(none)?;
    let best = field::LAMBDAS
        .iter()
        .filter_map(|&lambda| Some((lambda, field::cross_validate(&fits, Some(lambda))?)))
        .min_by(|a, b| a.1.rms_mm.total_cmp(&b.1.rms_mm));
    let best = best.filter(|(_, left_out)| left_out.rms_mm <= MAX_RMS_RATIO * plain.rms_mm);
    let (solved, left_out) = match &best {
        Some((lambda, left_out)) => (field::solve(&fits, *lambda), left_out),
        None => (None, &plain),
    };
    let spread = spread::estimate(views, &left_out.residuals_mm).ok_or_else(none)?;
    let field =
        solved.as_ref().map(|solved| DepthField { rectangle: over, coefficients_mm: solved.coefficients_mm });
    let tilt = tilt::estimate(views, field.as_ref()).ok_or_else(none)?;
    let field = match tilt.slope_mm {
        Some(slope_mm) => Some(field.unwrap_or_else(|| DepthField::zero(over)).with_linear_term(slope_mm)),
        None => field,
    };
    let rays = || views.iter().flat_map(|view| view.blocks.iter().map(|block| block.direction));
    let field_most_mm = field.map_or(0.0, |field| field::max_amplitude_mm(&field, rays()));
    let scales: Vec<f64> = views.iter().map(|view| view.scale_percent(field.as_ref())).collect();
    let scale_percent = scales.iter().sum::<f64>() / scales.len() as f64;
    let explained = views.iter().map(|view| view.scale_variance(spread.deviation_mm, spread.correlation_mm));
    let scale_deviation_percent = tilt.excess_std_percent(explained.sum::<f64>() / views.len() as f64);
    let mut whites: Vec<f64> = views.iter().map(|view| view.white_mm).collect();
    let depths = views.iter().map(|view| view.depth_mm);
    let parts = PictureParts::from_views(views, &left_out.residuals_mm, over);
    let residuals = left_out.residuals_mm.iter().map(|all| field::rms(all)).collect();
    Ok(ScannerErrors {
        white_mm: panelprep_base::geometry::median_in_place(&mut whites).unwrap_or(f64::NAN),
        smooth_mm: spread.deviation_mm,
        correlation_mm: spread.correlation_mm,
        correlation_interval_mm: spread.interval_mm,
        board_mm: views.iter().map(|view| 2.0 * view.half_diagonal_mm).fold(0.0, f64::max),
        left_out_uncorrected_mm: plain.rms_mm,
        left_out_corrected_mm: best.as_ref().map(|(_, left_out)| left_out.rms_mm),
        field,
        max_field_mm: field_most_mm,
        bow_mm: solved.map_or(0.0, |solved| solved.bow_mm),
        scale_percent,
        scale_deviation_percent,
        covered_share: parts.covered_share(),
        parts,
        depths_mm: [depths.clone().fold(f64::INFINITY, f64::min), depths.fold(0.0, f64::max)],
        turned_deg: gate::turned_deg(views),
        residuals_mm: residuals,
    })
}
