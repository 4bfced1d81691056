//! The gate: decides whether a camera's measured errors may be used, must be checked by a person, or are refused.

use super::found::ScannerErrors;
use super::plane_view::PlaneView;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Check, LimitSource};

/// Minimum number of scans, each with the board at another position: fewer give no information on a working volume.
pub const MIN_BOARD_POSITIONS: usize = 8;
/// Maximum bow of a calibration board, mm.
const MAX_BOW_MM: f64 = 0.5;
/// Minimum share of the picture in which at least two scans show the board.
const MIN_COVERED_SHARE: f64 = 0.6;
/// Minimum ratio of the largest depth to the smallest.
const DEPTHS: f64 = 1.15;
/// Minimum rotation of the board in its plane, degrees: with less, the board's bow is mistaken for an error of the
/// camera.
const MIN_BOARD_ROTATION_DEG: f64 = 40.0;
/// Limits of the smooth error, mm: beyond the first a person must look, beyond the second the camera is not used.
const SMOOTH_MM: [f64; 2] = [0.3, 1.0];
/// If distances are longer or shorter by more than this, a person must look, percent.
const SCALE_PERCENT: f64 = 0.3;
/// A board shows lengths up to this share of its diagonal: a plane through it absorbs longer ones.
const MAX_SHOWN_LENGTH_SHARE: f64 = 0.8;

/// Returns every number that is judged.
pub fn checks(found: &ScannerErrors) -> Vec<Check> {
    let [review_mm, reject_mm] = SMOOTH_MM;
    let is_bad = found.smooth_mm > reject_mm;
    let smooth = Check::new("smooth error of a scan", "mm", found.smooth_mm)
        .with_max(if is_bad { reject_mm } else { review_mm }, LimitSource::Program);
    let words = || {
        let [is, most] = distinguishable_texts(found.smooth_mm, if is_bad { reject_mm } else { review_mm }, 2);
        format!(
            "scans of a flat board deviate from a plane by {is} mm, differently in each scan (limit {most} mm); \
             warm up the camera, check its exposure, and have it calibrated by its manufacturer"
        )
    };
    let smooth =
        if is_bad { smooth.or_reject("scanner_smooth", words) } else { smooth.reviews("scanner_smooth", words) };
    vec![
        smooth,
        Check::new("share of the picture in which two scans have the board", "%", 100.0 * found.covered_share)
            .with_min(100.0 * MIN_COVERED_SHARE, LimitSource::Program)
            .reviews("scanner_covered", || {
                let [is, least] = distinguishable_texts(100.0 * found.covered_share, 100.0 * MIN_COVERED_SHARE, 0);
                format!(
                    "the board covers {is} % of the picture, at least {least} % are needed; hold the board in the \
                     corners of the picture, too"
                )
            }),
        Check::new("farthest over nearest place of the board", "", found.depths_mm[1] / found.depths_mm[0])
            .with_min(DEPTHS, LimitSource::Program)
            .reviews("scanner_depths", || {
                let [is, least] = distinguishable_texts(found.depths_mm[1] / found.depths_mm[0], DEPTHS, 2);
                format!(
                    "the farthest board is {is} times as far away as the nearest, at least {least} times is \
                     needed; hold the board nearer and farther"
                )
            }),
        Check::new("the board's turns in its plane", "°", found.turned_deg)
            .with_min(MIN_BOARD_ROTATION_DEG, LimitSource::Program)
            .reviews("scanner_turned", || {
                let [is, least] = distinguishable_texts(found.turned_deg, MIN_BOARD_ROTATION_DEG, 0);
                format!(
                    "the board was turned by {is}° in its plane, at least {least}° are needed: otherwise its own \
                     bow counts as an error of the camera; turn the board upright in some scans"
                )
            }),
        Check::new("the board's bow", "mm", found.bow_mm).with_max(MAX_BOW_MM, LimitSource::Program).reviews(
            "scanner_board",
            || {
                let [is, most] = distinguishable_texts(found.bow_mm, MAX_BOW_MM, 2);
                format!("the board is bowed by {is} mm (limit {most} mm); use a stiff board")
            },
        ),
        Check::new("scale of distances", "%", found.scale_percent.abs())
            .with_max(SCALE_PERCENT, LimitSource::Program)
            .reviews("scanner_scale", || {
                let [is, most] = distinguishable_texts(found.scale_percent.abs(), SCALE_PERCENT, 2);
                format!(
                    "distances on the board are off by {is} % (limit {most} %); measure the board's squares, and \
                     have the camera calibrated by its manufacturer"
                )
            }),
        Check::new("length over which the smooth error is alike", "mm", found.correlation_mm)
            .with_max(MAX_SHOWN_LENGTH_SHARE * found.board_mm, LimitSource::Program)
            .reviews("scanner_board_small", || {
                let [is, most] =
                    distinguishable_texts(found.correlation_mm, MAX_SHOWN_LENGTH_SHARE * found.board_mm, 0);
                format!(
                    "the smooth error is correlated over {is} mm, but boards of this size reveal at most {most} \
                     mm; use a larger board"
                )
            }),
    ]
}

/// Returns the largest angle between two rotations of the board, 0 to 90°: a bow looks the same after a rotation by
/// 180°.
pub(super) fn turned_deg(views: &[PlaneView]) -> f64 {
    let between = |a: f64, b: f64| {
        let off = (a - b).rem_euclid(180.0);
        off.min(180.0 - off)
    };
    let pairs = views.iter().flat_map(|a| views.iter().map(move |b| between(a.turn_deg, b.turn_deg)));
    pairs.fold(0.0, f64::max)
}
