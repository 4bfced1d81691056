//! The errors of the 3D camera, measured with a flat board at many positions in the working volume.
//!
//! A plane in front of the camera is linear in the directions (x, y) = (X/Z, Y/Z): 1/z = a + b x + c y. The remainder
//! of a scan of a flat board is the error of the camera, in five parts:
//! - white noise, from pixel to pixel, which increases with z²;
//! - the error that is the same in each scan (`field`): a correction, used only if it predicts scans that were left
//!   out;
//! - the smooth error that differs from scan to scan (`field`): its standard deviation and its correlation length, from
//!   means over parts of the board, since a plane through the board absorbs a part;
//! - the bow of the board, which rotates with the board and can therefore be distinguished;
//! - scale: the ratio of measured to printed distances between corners; from scan to scan the part that the smooth
//!   error does not explain. If distances are longer on one side of the picture, planes are mapped to other planes;
//!   this tilt is also corrected (`field`).
//!
//! [`checks`] decides whether the measured errors may be used, must be checked by a person, or are refused. The lens is
//! not measured here (`intrinsics`).

mod field;
mod plane_view;

use super::error::CalibError;
use field::ProjectedScan;
use panelprep_base::geometry::statistics::rms;
use panelprep_base::geometry::{Camera, DepthField, FieldRectangle, PinholeCamera, Pixel, interpolated_median};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Check, LimitSource};
pub use plane_view::{Block, BoardScan, MIN_SCANS, PicturePart, PictureParts, PlaneView};

/// Returns the range of the directions of the whole picture of a camera; `None` if one of its corners has no ray.
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

/// Maximum ratio of the left-out rms with a correction to that without; with a larger ratio the error that is the same
/// in each scan is not corrected.
const MAX_RMS_RATIO: f64 = 0.9;

/// Measures the errors of the camera.
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
    let best = field::ROUGHNESS_WEIGHTS
        .iter()
        .filter_map(|&lambda| Some((lambda, field::cross_validate(&fits, Some(lambda))?)))
        .min_by(|a, b| a.1.rms_mm.total_cmp(&b.1.rms_mm));
    let best = best.filter(|(_, left_out)| left_out.rms_mm <= MAX_RMS_RATIO * plain.rms_mm);
    let (solved, left_out) = match &best {
        Some((lambda, left_out)) => (field::solve(&fits, *lambda), left_out),
        None => (None, &plain),
    };
    let spread = field::estimate_smooth_error(views, &left_out.residuals_mm).ok_or_else(none)?;
    let field =
        solved.as_ref().map(|solved| DepthField { rectangle: over, coefficients_mm: solved.coefficients_mm });
    let tilt = field::estimate_tilt(views, field.as_ref()).ok_or_else(none)?;
    let field = match tilt.slope_mm {
        Some(slope_mm) => Some(field.unwrap_or_else(|| DepthField::zero(over)).with_linear_term(slope_mm)),
        None => field,
    };
    let rays = || views.iter().flat_map(|view| view.blocks.iter().map(|block| block.direction));
    let field_most_mm = field.map_or(0.0, |field| field::max_amplitude_mm(&field, rays()));
    let scales: Vec<f64> = views.iter().map(|view| view.scale_percent(field.as_ref())).collect();
    let scale_percent = scales.iter().sum::<f64>() / scales.len() as f64;
    let explained = views.iter().map(|view| view.variance_of_scale(spread.deviation_mm, spread.correlation_mm));
    let scale_deviation_percent = tilt.excess_std_percent(explained.sum::<f64>() / views.len() as f64);
    let mut whites: Vec<f64> = views.iter().map(|view| view.white_mm).collect();
    let depths = views.iter().map(|view| view.depth_mm);
    let parts = PictureParts::from_views(views, &left_out.residuals_mm, over);
    let residuals = left_out.residuals_mm.iter().map(|all| rms(all.iter().copied())).collect();
    Ok(ScannerErrors {
        white_mm: interpolated_median(&mut whites).unwrap_or(f64::NAN),
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
        turned_deg: turned_deg(views),
        residuals_mm: residuals,
    })
}

/// The measured errors of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ScannerErrors {
    /// White noise of a pixel at the reference depth, standard deviation, mm.
    pub white_mm: f64,
    /// Standard deviation of the smooth error of one scan, after the correction if there is one, mm.
    pub smooth_mm: f64,
    /// Side of the squares within which the smooth error is treated as equal, mm.
    pub correlation_mm: f64,
    /// 95 % confidence interval of `correlation_mm`, mm.
    pub correlation_interval_mm: [f64; 2],
    /// Maximum correlation length that the boards can show, mm: their diagonal.
    pub board_mm: f64,
    /// The rms deviation from the plane in left-out scans, without a correction, mm.
    pub left_out_uncorrected_mm: f64,
    /// The rms deviation in left-out scans with the correction from the other scans, mm; `None` if the correction is
    /// not better.
    pub left_out_corrected_mm: Option<f64>,
    /// The correction; `None` if no error is the same in each scan.
    pub field: Option<DepthField>,
    /// Maximum absolute value of the correction at the reference depth, at the positions of boards, mm.
    pub max_field_mm: f64,
    /// Bow of the board over half of its diagonal, mm.
    pub bow_mm: f64,
    /// Ratio of measured to printed distances, minus one, percent: the mean over the scans.
    pub scale_percent: f64,
    /// Standard deviation of the scale from scan to scan, without the part that the smooth error explains, percent.
    pub scale_deviation_percent: f64,
    /// For each part of the picture, the number of scans and the residual.
    pub parts: PictureParts,
    /// Fraction of the picture in which at least two scans show the board.
    pub covered_share: f64,
    /// Minimum and maximum depth of the centre of a board, mm.
    pub depths_mm: [f64; 2],
    /// Maximum difference between two rotations of the board in its plane, degrees.
    pub turned_deg: f64,
    /// For each scan, the rms residual of the plane of the board after the correction, mm.
    pub residuals_mm: Vec<f64>,
}

/// Minimum number of scans, each with the board at another position; fewer give no information on a working volume.
pub const MIN_BOARD_POSITIONS: usize = 8;
/// Maximum bow of a calibration board, mm.
const MAX_BOW_MM: f64 = 0.5;
/// Minimum fraction of the picture in which at least two scans show the board.
const MIN_COVERED_FRACTION: f64 = 0.6;
/// Minimum ratio of the largest to the smallest depth of a board.
const MIN_DEPTH_RATIO: f64 = 1.15;
/// Minimum rotation of the board in its plane, degrees: with less, the bow of the board cannot be distinguished from an
/// error of the camera.
const MIN_BOARD_ROTATION_DEG: f64 = 40.0;
/// Limits of the smooth error, mm: beyond the first a person must check, beyond the second the camera is not used.
const SMOOTH_ERROR_LIMITS_MM: [f64; 2] = [0.3, 1.0];
/// Maximum scale error of distances without a review, percent.
const MAX_SCALE_PERCENT: f64 = 0.3;
/// Maximum correlation length that a board can show, as a fraction of its diagonal: the plane through the board absorbs
/// longer ones.
const MAX_RELATIVE_CORRELATION_LENGTH: f64 = 0.8;

/// Returns the checks of all judged values.
pub fn checks(found: &ScannerErrors) -> Vec<Check> {
    let [review_mm, reject_mm] = SMOOTH_ERROR_LIMITS_MM;
    let is_bad = found.smooth_mm > reject_mm;
    let smooth = Check::new("smooth error of a scan", "mm", found.smooth_mm)
        .with_max(if is_bad { reject_mm } else { review_mm }, LimitSource::Program);
    let words = || {
        let [is, most] = distinguishable_texts(found.smooth_mm, if is_bad { reject_mm } else { review_mm }, 2);
        format!(
            "scans of a flat board deviate from a plane by {is} mm, and this error differs from scan to scan (limit \
             {most} mm); warm up the camera, check its exposure, and have it calibrated by its manufacturer"
        )
    };
    let smooth =
        if is_bad { smooth.or_reject("scanner_smooth", words) } else { smooth.or_review("scanner_smooth", words) };
    vec![
        smooth,
        Check::new("share of the picture in which two scans have the board", "%", 100.0 * found.covered_share)
            .with_min(100.0 * MIN_COVERED_FRACTION, LimitSource::Program)
            .or_review("scanner_covered", || {
                let [is, least] =
                    distinguishable_texts(100.0 * found.covered_share, 100.0 * MIN_COVERED_FRACTION, 0);
                format!(
                    "the board covers {is} % of the picture, at least {least} % are needed; hold the board in the \
                     corners of the picture, too"
                )
            }),
        Check::new("farthest over nearest place of the board", "", found.depths_mm[1] / found.depths_mm[0])
            .with_min(MIN_DEPTH_RATIO, LimitSource::Program)
            .or_review("scanner_depths", || {
                let [is, least] =
                    distinguishable_texts(found.depths_mm[1] / found.depths_mm[0], MIN_DEPTH_RATIO, 2);
                format!(
                    "the farthest board is {is} times as far away as the nearest, at least {least} times is \
                     needed; hold the board nearer and farther"
                )
            }),
        Check::new("the board's turns in its plane", "°", found.turned_deg)
            .with_min(MIN_BOARD_ROTATION_DEG, LimitSource::Program)
            .or_review("scanner_turned", || {
                let [is, least] = distinguishable_texts(found.turned_deg, MIN_BOARD_ROTATION_DEG, 0);
                format!(
                    "the board was rotated by {is}° in its plane, at least {least}° are needed: otherwise the bow of the board is mistaken for an error of the camera; rotate the board by 90° in some scans"
                )
            }),
        Check::new("the board's bow", "mm", found.bow_mm).with_max(MAX_BOW_MM, LimitSource::Program).or_review(
            "scanner_board",
            || {
                let [is, most] = distinguishable_texts(found.bow_mm, MAX_BOW_MM, 2);
                format!("the board is bowed by {is} mm (limit {most} mm); use a stiff board")
            },
        ),
        Check::new("scale of distances", "%", found.scale_percent.abs())
            .with_max(MAX_SCALE_PERCENT, LimitSource::Program)
            .or_review("scanner_scale", || {
                let [is, most] = distinguishable_texts(found.scale_percent.abs(), MAX_SCALE_PERCENT, 2);
                format!(
                    "distances on the board are off by {is} % (limit {most} %); measure the board's squares, and \
                     have the camera calibrated by its manufacturer"
                )
            }),
        Check::new("length over which the smooth error is alike", "mm", found.correlation_mm)
            .with_max(MAX_RELATIVE_CORRELATION_LENGTH * found.board_mm, LimitSource::Program)
            .or_review("scanner_board_small", || {
                let [is, most] = distinguishable_texts(
                    found.correlation_mm,
                    MAX_RELATIVE_CORRELATION_LENGTH * found.board_mm,
                    0,
                );
                format!(
                    "the smooth error is correlated over {is} mm, but boards of this size reveal at most {most} \
                     mm; use a larger board"
                )
            }),
    ]
}

/// Returns the maximum angle between two rotations of the board, 0 to 90°: a bow looks the same after a rotation by
/// 180°.
fn turned_deg(views: &[PlaneView]) -> f64 {
    let between = |a: f64, b: f64| {
        let off = (a - b).rem_euclid(180.0);
        off.min(180.0 - off)
    };
    let pairs = views.iter().flat_map(|a| views.iter().map(move |b| between(a.turn_deg, b.turn_deg)));
    pairs.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    //! Tests with scans of a rendered board by a camera with known errors.

    use super::*;
    use crate::calib::Board;
    use panelprep_base::geometry::{Camera, OrganizedCloud, PinholeCamera};
    use panelprep_sim::{BoardCell, BoardPrint, RobotNoise, ScannerDistortion};
    use rayon::prelude::*;

    const NO_NOISE: RobotNoise = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };

    fn over(camera: &PinholeCamera) -> FieldRectangle {
        direction_rectangle(camera).expect("rays")
    }

    /// Returns scans of a board by a camera; in some of them the board is far away and in the corners of the picture.
    fn views(seed: u64, count: usize, distortion: &ScannerDistortion) -> (Vec<PlaneView>, PinholeCamera) {
        views_at_scale(seed, count, distortion, |_| 0.0)
    }

    /// Returns the scans of a camera whose distances are too long, by the fraction that `scale` gives for each scan.
    fn views_at_scale(
        seed: u64,
        count: usize,
        distortion: &ScannerDistortion,
        scale: impl Fn(u64) -> f64 + Sync,
    ) -> (Vec<PlaneView>, PinholeCamera) {
        views_by(seed, count, distortion, |index, cloud| cloud.scaled_along_rays(|_| 1.0 + scale(index)))
    }

    /// Returns the scans of `views`, with this change of each scan by the camera.
    fn views_by(
        seed: u64,
        count: usize,
        distortion: &ScannerDistortion,
        scanned: impl Fn(u64, OrganizedCloud<Camera>) -> OrganizedCloud<Camera> + Sync,
    ) -> (Vec<PlaneView>, PinholeCamera) {
        let print = BoardPrint::chessboard(8, 6, 30.0);
        let cell = BoardCell::new(seed, print, NO_NOISE).with_reduction(4);
        let board = Board::parse("8x6", 30.0).expect("a board");
        let camera = cell.scanner();
        let views = cell
            .scanner_shots(count)
            .par_iter()
            .map(|shot| {
                let corners = cell.corners(&camera, shot, 0.05);
                let cloud: OrganizedCloud<Camera> = scanned(shot.index, cell.real_scan(shot, distortion));
                let scan = BoardScan { cloud: &cloud, camera: &camera, board: &board, corners: &corners };
                PlaneView::from_scan(&scan).expect("a board")
            })
            .collect();
        (views, camera)
    }

    /// Returns the rms of the true error at the positions of boards before and after the correction, mm, without the
    /// part that maps planes to other planes.
    fn errors_before_and_after_mm(
        found: &ScannerErrors,
        distortion: &ScannerDistortion,
        views: &[PlaneView],
    ) -> [f64; 2] {
        let of = |value: &dyn Fn([f64; 2]) -> f64| {
            let blocks = views.iter().flat_map(|view| &view.blocks);
            let all: Vec<([f64; 2], f64)> = blocks.map(|block| (block.direction, value(block.direction))).collect();
            let linear = plane_view::fit_plane(all.iter().copied()).expect("a plane");
            rms(all.iter().map(|(at, mm)| mm - plane_view::value_at(&linear, *at)))
        };
        let field = found.field.expect("a correction");
        [of(&|at| distortion.distortion_at_mm(at)), of(&|at| distortion.distortion_at_mm(at) - field.at_mm(at))]
    }

    #[test]
    fn the_error_that_is_the_same_in_each_scan_is_found() {
        let distortion = ScannerDistortion::new(5, 1.0);
        let (views, camera) = views(7, 16, &distortion);
        let found = measure(&views, over(&camera)).expect("measured");
        println!("{found:?}");
        let [before_mm, after_mm] = errors_before_and_after_mm(&found, &distortion, &views);
        println!("true error {before_mm:.3} mm rms, after the correction {after_mm:.3} mm");
        assert!(before_mm > 0.1 && after_mm < 0.25 * before_mm, "{before_mm} {after_mm}");
        let corrected_mm = found.left_out_corrected_mm.expect("better");
        assert!(corrected_mm < 0.6 * found.left_out_uncorrected_mm);
        assert!((found.white_mm - 0.055).abs() < 0.008, "{}", found.white_mm);
    }

    #[test]
    fn without_an_error_that_is_the_same_nothing_is_corrected() {
        let none = ScannerDistortion::new(5, 0.0);
        let (views, camera) = views(11, 12, &none);
        let found = measure(&views, over(&camera)).expect("measured");
        println!("{found:?}");
        assert_eq!((found.field, found.left_out_corrected_mm), (None, None));
        assert!(found.scale_percent.abs() < 0.1 && found.bow_mm == 0.0, "{found:?}");
        let few = measure(&views[..7], over(&camera)).expect_err("few").to_string();
        assert!(few.contains("7 scans") && few.contains("8 are needed"), "{few}");
    }

    /// A depth error that increases by 1 mm for each unit of the direction leaves boards flat: only the distances on
    /// the boards show it.
    #[test]
    fn a_tilt_of_planes_is_found_by_distances() {
        let bent = ScannerDistortion::new(5, 0.0);
        let tilted = |cloud: OrganizedCloud<Camera>| {
            cloud.scaled_along_rays(|[x, _, z]| {
                1.0 / (1.0 - z * (x / z) / panelprep_base::geometry::REFERENCE_DEPTH_MM.powi(2))
            })
        };
        let (views, camera) = views_by(7, 16, &bent, |_, cloud| tilted(cloud));
        let found = measure(&views, over(&camera)).expect("measured");
        let field = found.field.expect("a correction");
        let slope_mm = [[0.2, 0.0], [0.0, 0.2]].map(|at| (field.at_mm(at) - field.at_mm([0.0, 0.0])) / 0.2);
        println!("{slope_mm:?} {found:?}");
        assert!((slope_mm[0] - 1.0).abs() < 0.2 && slope_mm[1].abs() < 0.2, "{slope_mm:?}");
    }

    /// Expected values, calculated by hand: alternating scale errors of 0.15 % and 0.05 % have a mean of 0.1 %, and
    /// each differs from it by 0.05 %. The two terms of the fit absorb a part of this difference. The effect of the
    /// smooth error alone on distances is not included.
    #[test]
    fn scale_from_scan_to_scan_is_distinguished_from_the_smooth_error() {
        let none = ScannerDistortion::new(5, 0.0);
        let mut alike: Vec<f64> = Vec::new();
        for seed in 30..34 {
            let (views, camera) = views(seed, 12, &none);
            alike.push(measure(&views, over(&camera)).expect("measured").scale_deviation_percent);
            let (views, camera) =
                views_at_scale(seed, 12, &none, |index| if index % 2 == 0 { 0.0015 } else { 0.0005 });
            let found = measure(&views, over(&camera)).expect("measured");
            println!("{alike:?} {} {}", found.scale_percent, found.scale_deviation_percent);
            assert!((found.scale_percent - 0.1).abs() < 0.02, "{}", found.scale_percent);
            assert!((found.scale_deviation_percent - 0.052).abs() < 0.015, "{}", found.scale_deviation_percent);
        }
        assert!(alike.iter().all(|percent| *percent < 0.02), "{alike:?}");
    }

    /// The mean of the smooth error over a large area depends only on the product of its standard deviation and its
    /// correlation length. Expected value, calculated by hand for the simulator's 0.06 mm rms at the nodes of a lattice
    /// of 50 to 85 mm: each node represents one cell, so the product is 0.06 · √(mean of the cells' areas) = 0.06 ·
    /// 68.2 = 4.1 mm².
    #[test]
    fn size_and_length_of_the_smooth_error_agree_with_the_simulator() {
        let none = ScannerDistortion::new(5, 0.0);
        let products: Vec<f64> = (20..26)
            .map(|seed| {
                let (views, camera) = views(seed, 12, &none);
                let found = measure(&views, over(&camera)).expect("measured");
                println!(
                    "{:.4} mm over {} mm, {:?}",
                    found.smooth_mm, found.correlation_mm, found.correlation_interval_mm
                );
                found.smooth_mm * found.correlation_mm
            })
            .collect();
        let mean = products.iter().sum::<f64>() / products.len() as f64;
        assert!((mean - 4.1).abs() < 0.6, "{mean} {products:?}");
    }
}
