//! Judges verifications against a known target: whether a calibration is still valid, and whether a cycle may start
//! with it.

use super::board::Board;
use panelprep_base::geometry::{Base, Board as BoardFrame, Pixel, Point, Rigid};
use panelprep_base::number_text::{distinguishable_percents, distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::{LensExtent, Limits};

/// Subject of a verification of the force of a compliant tool without contact; its error and its limit are in N.
pub const TOOL_FORCE: &str = "tool_force";

/// Returns the unit of the error and the limit of a subject.
pub fn unit(subject: &str) -> &'static str {
    if subject == TOOL_FORCE { "N" } else { "mm" }
}

/// A verification with a picture of a fixed target, or with a touch.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// Subject of the verification: `scanner`, `flange_camera`, `tool`, or the force of a compliant tool,
    /// [`TOOL_FORCE`], with values in N.
    pub subject: String,
    /// Maximum distance between the known and the measured position of the target, mm; for a force, the error in N.
    pub error: f64,
    /// Maximum error, in the unit of the error.
    pub limit: f64,
    /// Content hash of the calibration files that were used, in the order of the keys in the cell's file.
    pub calibration_hash: String,
    /// Time of the verification, seconds since 1970.
    pub at_unix_s: i64,
    /// The strike, if a person struck out the verification: it stays in the store, but is no longer used.
    pub struck: Option<Strike>,
}

/// The strike of a wrong verification, with person and reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Strike {
    /// Name of the person.
    pub by: String,
    /// Reason of the strike.
    pub why: String,
    /// Time of the strike, seconds since 1970.
    pub at_unix_s: i64,
}

/// The requirements of the cell's file for the last verification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerificationLimits {
    /// Maximum error, in the unit of the subject.
    pub limit: f64,
    /// Maximum age of the verification, hours.
    pub max_age_h: f64,
}

impl VerificationLimits {
    /// Returns the requirements of the cell's file.
    pub fn from_limits(limits: &Limits) -> Self {
        VerificationLimits { limit: limits.verify_limit_mm(), max_age_h: limits.verify_max_age_h() }
    }
}

/// Returns the deviation of a board from its known pose: the maximum distance of its corners, mm.
pub fn distance_mm(
    known: &Rigid<Base, BoardFrame>,
    found: &Rigid<Base, BoardFrame>,
    corners: &[Point<BoardFrame>],
) -> f64 {
    corners.iter().map(|&corner| known.distance_at_mm(*found, corner)).fold(0.0, f64::max)
}

/// Returns the side of a board's squares according to the touched corners, since the lengths of the arm are metric. The
/// side is the stated side times the ratio of the distances between the touched points to those on the board (least
/// squares). `None` if fewer than two corners were touched.
pub fn square_size_from_touches(board: &Board, touched: &[(Point<BoardFrame>, Point<Base>)]) -> Option<f64> {
    let (mut both, mut own) = (0.0, 0.0);
    for (index, first) in touched.iter().enumerate() {
        for second in &touched[index + 1..] {
            let (of_board, of_arm) = (first.0.distance_mm(second.0), first.1.distance_mm(second.1));
            // The sums are over all pairs, weighted by their distance: long distances determine the scale, short ones
            // mainly contain the error of the touches.
            both += of_board * of_arm;
            own += of_board * of_board;
        }
    }
    (own > 0.0).then(|| board.square_mm() * both / own)
}

/// Maximum reprojection error of a flat board of squares with a correct lens, px rms.
const MAX_PNP_RMS_PX: f64 = 1.0;
/// Maximum rotation of the board in the view of a bumped camera, degrees. If the corners are counted from another
/// corner, the board appears rotated by 90° or 180°.
const MAX_BOARD_ROTATION_DEG: f64 = 20.0;
/// Maximum relative difference between the size of the squares that the 3D camera measures and the stated size.
const MAX_RELATIVE_SQUARE_DIFFERENCE: f64 = 0.02;

/// The pose of a board, measured with one picture.
#[derive(Debug, Clone, Copy)]
pub struct BoardMeasurement {
    /// The pose of the board in the base frame.
    pub base_from_board: Rigid<Base, BoardFrame>,
    /// Distance of the corners from their computed pixels at this pose, px rms.
    pub pnp_rms_px: f64,
    /// Side of a square, calculated from the points of the 3D camera, mm.
    pub measured_square_mm: Option<f64>,
}

/// Returns the reason why the measured corners cannot be those of this board; `None` if they can.
pub fn board_mismatch(look: &BoardMeasurement, board: &Board) -> Option<Reason> {
    let rms_px = look.pnp_rms_px;
    if rms_px.is_nan() || rms_px > MAX_PNP_RMS_PX {
        let [rms, allowed] = distinguishable_texts(rms_px, MAX_PNP_RMS_PX, 2);
        return Some(implausible_reason(format!(
            "the corners are {rms} px rms off the positions at which this lens would see a flat board of squares \
             (limit {allowed} px): check that the board is flat, and that the picture is from this camera."
        )));
    }
    let (measured_mm, square_mm) = (look.measured_square_mm?, board.square_mm());
    let differs = (measured_mm / square_mm - 1.0).abs();
    (differs.is_nan() || differs > MAX_RELATIVE_SQUARE_DIFFERENCE).then(|| {
        let [share, allowed] = distinguishable_percents(differs, MAX_RELATIVE_SQUARE_DIFFERENCE, 1);
        implausible_reason(format!(
            "the 3D camera measures squares of {} mm, but the stated side is {square_mm} mm, a difference of \
             {share} % (limit {allowed} %): measure the board, and correct its size.",
            fixed_decimals(measured_mm, 2)
        ))
    })
}

/// Returns the reason why a measurement at these pixels is refused: the lens calibration is not valid there. `None` if
/// it is valid at all of them.
pub fn lens_extent_refusal(extent: &LensExtent, pixels: impl IntoIterator<Item = Pixel>) -> Option<Reason> {
    let error_px = extent.supported.as_ref()?.error_px;
    let pixel = pixels.into_iter().find(|pixel| !extent.contains_pixel(*pixel))?;
    let (u, v) = (fixed_decimals(pixel.u, 0), fixed_decimals(pixel.v, 0));
    let message = format!(
        "pixel ({u}, {v}) lies outside of the part of the picture in which the lens is calibrated to {error_px:.2} \
         px (supported_px in its file): take the picture from a pose that shows this point nearer to the middle, \
         or calibrate the lens with pictures of the board in this part"
    );
    Some(Reason::new("outside_of_lens", message))
}

/// Returns the reason why a measurement contains no information on the calibration: it shows another board, a board at
/// another position, or belongs to another pose of the flange. `None` if it can be used.
///
/// A bumped camera shows the board displaced by less than half of the diagonal of the board, and rotated by less than
/// 20°.
pub fn uninformative_measurement(
    known: &Rigid<Base, BoardFrame>,
    look: &BoardMeasurement,
    board: &Board,
) -> Option<Reason> {
    if let Some(reason) = board_mismatch(look, board) {
        return Some(reason);
    }
    let turn_deg = (known.inverse() * look.base_from_board).rotation_angle().0;
    if turn_deg.is_nan() || turn_deg > MAX_BOARD_ROTATION_DEG {
        let [turn, allowed] = distinguishable_texts(turn_deg, MAX_BOARD_ROTATION_DEG, 0);
        return Some(implausible_reason(format!(
            "the board appears rotated by {turn}° (limit {allowed}°): check that its corners are counted as in the \
             target's file, that the board was not moved, and that --flange is the flange pose of this picture."
        )));
    }
    let (middle, first) = (board.centre(), Point::at(0.0, 0.0, 0.0));
    let (off_mm, allowed_mm) = (known.distance_at_mm(look.base_from_board, middle), middle.distance_mm(first));
    (off_mm.is_nan() || off_mm > allowed_mm).then(|| {
        let [off, allowed] = distinguishable_texts(off_mm, allowed_mm, 0);
        implausible_reason(format!(
            "the board appears {off} mm from its expected position (limit: half of its diagonal, {allowed} mm): \
             check that the board was not moved, that its size in the target's file is right, and that --flange is \
             the flange pose of this picture."
        ))
    })
}

/// Returns the reason why the pose of a board is not accepted as a reference: the points of the 3D camera and its
/// picture give different distances. `None` if they agree.
pub fn depth_differs(farther_mm: f64, limit_mm: f64) -> Option<Reason> {
    (farther_mm.is_nan() || farther_mm.abs() > limit_mm).then(|| {
        let [found, allowed] = distinguishable_texts(farther_mm.abs(), limit_mm, 2);
        let way = if farther_mm > 0.0 { "farther away" } else { "nearer" };
        let message = format!(
            "according to the points of the 3D camera, the board is {found} mm {way} than according to its picture (limit {allowed} mm): \
             measure the board's squares, and measure the camera's scale with `panelprep calibrate scanner`"
        );
        Reason::new("depth_differs", message)
    })
}

fn implausible_reason(what: String) -> Reason {
    let message = format!(
        "{what} This measurement was not stored, and the last verification remains valid; if the camera was really \
         moved by this amount, calibrate it again before the next cycle"
    );
    Reason::new("implausible", message)
}

/// Returns a reason if the error of a verification is larger than the present limit in the cell's file. A NaN is beyond
/// every limit.
pub fn exceeded_limit_reason(last: &Verification, demands: VerificationLimits) -> Option<Reason> {
    let (subject, found, allowed) = (&last.subject, last.error, demands.limit);
    (found.is_nan() || found > allowed).then(|| {
        let ([found, allowed], unit) = (distinguishable_texts(found, allowed, 3), unit(subject));
        let message = format!(
            "the last verification of {subject} found an error of {found} {unit} (limit {allowed} {unit}); check \
             whether something was bumped, calibrate {subject} again, and verify it"
        );
        Reason::new("verification_limit", message)
    })
}

fn advice(subject: &str) -> String {
    if subject == TOOL_FORCE {
        return "run `panelprep calibrate force --verify`".to_owned();
    }
    format!("run `panelprep calibrate verify --camera {}`", subject.replace('_', "-"))
}

/// Judges whether a cycle may start. `last` is the newest verification of this subject; `calibration_hash` is the hash
/// of the present calibration files.
///
/// Rejects if the verification is missing, older than its maximum age, from the future, beyond the limit, or of other
/// calibration files.
pub fn health(
    subject: &str,
    last: Option<&Verification>,
    calibration_hash: &str,
    now_unix_s: i64,
    demands: VerificationLimits,
) -> Judgement {
    let Some(last) = last else {
        let message = format!("{subject} has never been verified; {}", advice(subject));
        return Judgement::new(vec![Reason::new("not_verified", message)], vec![]);
    };
    if let Some(Strike { by, why, .. }) = &last.struck {
        let message =
            format!("the last verification of {subject} was struck out by {by} ({why}); {}", advice(subject));
        return Judgement::new(vec![Reason::new("verification_struck", message)], vec![]);
    }
    let mut reject = Vec::new();
    let age_h = (now_unix_s - last.at_unix_s) as f64 / 3600.0;
    if age_h < 0.0 {
        let message = format!(
            "the last verification of {subject} is dated {:.1} h in the future; set the computer's clock",
            -age_h
        );
        reject.push(Reason::new("verification_ahead", message));
    }
    if age_h > demands.max_age_h {
        let [age, allowed] = distinguishable_texts(age_h, demands.max_age_h, 1);
        let message = format!("{subject} was verified {age} h ago (limit {allowed} h); {}", advice(subject));
        reject.push(Reason::new("verification_old", message));
    }
    reject.extend(exceeded_limit_reason(last, demands));
    if last.calibration_hash != calibration_hash {
        let message = format!(
            "{subject} was verified with calibration files other than the present ones; {}",
            advice(subject)
        );
        reject.push(Reason::new("verification_other", message));
    }
    Judgement::new(reject, vec![])
}

/// Fraction of the maximum age of a verification after which a warning is given.
const WARNING_AGE_FRACTION: f64 = 0.9;

/// Returns a warning for a verification that is still valid but will soon be too old.
pub fn expiry_warning(last: &Verification, now_unix_s: i64, demands: VerificationLimits) -> Option<Reason> {
    let age_h = (now_unix_s - last.at_unix_s) as f64 / 3600.0;
    let is_soon =
        last.struck.is_none() && age_h > WARNING_AGE_FRACTION * demands.max_age_h && age_h <= demands.max_age_h;
    is_soon.then(|| {
        let (subject, advice) = (&last.subject, advice(&last.subject));
        let [age, allowed] = distinguishable_texts(age_h, demands.max_age_h, 1);
        let message = format!(
            "{subject} was verified {age} h ago; no cycle can start when this is more than {allowed} h ago; \
             {advice}"
        );
        Reason::new("verification_ends", message)
    })
}

impl Verification {
    /// Returns whether the verification is valid for the calibration files with this hash: no person struck it out, and
    /// it was made with these files.
    pub fn counts_for(&self, calibration_hash: &str) -> bool {
        self.struck.is_none() && self.calibration_hash == calibration_hash
    }
}

/// A camera with which a cycle measures.
#[derive(Debug, Clone, Copy)]
pub struct CameraHealth<'a> {
    /// Subject of the verification, such as `scanner`.
    pub subject: &'a str,
    /// The newest verification of the subject.
    pub last: Option<&'a Verification>,
    /// Hash of the present calibration files of the camera.
    pub calibration_hash: &'a str,
}

/// Judges whether a cycle may start with these calibrations.
///
/// Rejects if [`health`] rejects a camera, or if the error of the newest touch with the present tool was beyond the
/// limit. A touch is not required: without one, the robot's part of the error is not measured, and the error budget
/// states this.
pub fn judge_start(
    cameras: &[CameraHealth<'_>],
    touch: Option<&Verification>,
    now_unix_s: i64,
    demands: VerificationLimits,
) -> Judgement {
    let of_camera = |camera: &CameraHealth<'_>| {
        health(camera.subject, camera.last, camera.calibration_hash, now_unix_s, demands).reasons
    };
    // A touch with an error beyond the limit prevents the start; a missing touch is only stated in the error budget.
    let of_touch = touch.and_then(|touch| exceeded_limit_reason(touch, demands));
    Judgement::new(cameras.iter().flat_map(of_camera).chain(of_touch).collect(), vec![])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use panelprep_base::verdict::Verdict;

    const REQUIREMENTS: VerificationLimits = VerificationLimits { limit: 0.5, max_age_h: 24.0 };

    /// Both cameras must have been verified. If a tool was never touched, the cycle may start; if the error of its last
    /// touch was beyond the limit, it may not.
    #[test]
    fn a_cycle_starts_with_verified_cameras_and_without_a_bad_touch() {
        let last = |subject: &str, error: f64| Verification {
            subject: subject.to_owned(),
            error,
            limit: 0.5,
            calibration_hash: "h".to_owned(),
            at_unix_s: 0,
            struck: None,
        };
        let (scanner, touch) = (last("scanner", 0.1), last("tool", 0.6));
        let camera = |last| CameraHealth { subject: "scanner", last, calibration_hash: "h" };
        let codes = |cameras: &[CameraHealth<'_>], touch| -> Vec<String> {
            let judgement = judge_start(cameras, touch, 3_600, REQUIREMENTS);
            judgement.reasons.into_iter().map(|reason| reason.code.into_owned()).collect()
        };
        assert_eq!(codes(&[camera(Some(&scanner))], None), Vec::<String>::new());
        assert_eq!(codes(&[camera(Some(&scanner)), camera(None)], None), ["not_verified"]);
        assert_eq!(codes(&[camera(Some(&scanner))], Some(&touch)), ["verification_limit"]);
    }

    fn verified(error: f64, at_unix_s: i64) -> Verification {
        let subject = "scanner".to_owned();
        Verification { subject, error, limit: 0.5, calibration_hash: "ab".to_owned(), at_unix_s, struck: None }
    }

    /// Expected value, calculated by hand: the last 10 % of 24 h begin after 21.6 h.
    #[test]
    fn a_warning_is_given_in_the_last_tenth_of_a_verification() {
        let now = 1_700_000_000;
        let code = |hours: f64| {
            let last = verified(0.2, now - (hours * 3_600.0) as i64);
            expiry_warning(&last, now, REQUIREMENTS).map(|reason| reason.code.into_owned())
        };
        assert_eq!([code(21.5), code(24.1)], [None, None]);
        assert_eq!([code(21.7), code(23.9)].map(|code| code.expect("soon")), ["verification_ends"; 2]);
        let strike = Strike { by: "A. Smith".to_owned(), why: "another board".to_owned(), at_unix_s: now };
        let struck = Verification { struck: Some(strike), ..verified(0.2, now - 23 * 3_600) };
        assert_eq!(expiry_warning(&struck, now, REQUIREMENTS), None);
    }

    #[test]
    fn a_cycle_starts_only_with_a_recent_and_good_verification() {
        let now = 1_700_000_000;
        let judge =
            |last: Option<Verification>, hash: &str| health("scanner", last.as_ref(), hash, now, REQUIREMENTS);
        assert_eq!(judge(Some(verified(0.2, now - 3600)), "ab").verdict, Verdict::Accept);
        let strike = Strike { by: "A. Smith".to_owned(), why: "another board".to_owned(), at_unix_s: now };
        let struck = Verification { struck: Some(strike), ..verified(0.2, now - 60) };
        for (last, hash, code) in [
            (None, "ab", "not_verified"),
            (Some(struck), "ab", "verification_struck"),
            (Some(verified(0.2, now - 25 * 3600)), "ab", "verification_old"),
            (Some(verified(0.2, now + 60)), "ab", "verification_ahead"),
            (Some(verified(0.6, now - 60)), "ab", "verification_limit"),
            (Some(verified(f64::NAN, now - 60)), "ab", "verification_limit"),
            (Some(verified(0.2, now - 60)), "cd", "verification_other"),
        ] {
            let judged = judge(last, hash);
            assert_eq!(judged.verdict, Verdict::Reject);
            assert!(judged.reasons.iter().any(|reason| reason.code == code), "{code}: {judged:?}");
            assert!(
                judged.reasons.iter().all(|reason| reason.message.contains("verify") || code.ends_with("ahead"))
            );
        }
    }

    /// Expected values, calculated by hand for a board of 5 × 4 corners and squares of 40 mm: its centre is 100 mm from
    /// its first corner, and 40 mm plus 2 % are 40.8 mm. Each limit is tested on both sides.
    #[test]
    fn another_board_is_distinguished_from_a_bumped_camera() {
        let board = Board::parse("5x4", 40.0).expect("a board");
        let known: Rigid<Base, BoardFrame> =
            Rigid::from_isometry_unchecked(Isometry3::translation(500.0, 0.0, 0.0));
        let look = |x_mm: f64, turn_deg: f64, pnp_rms_px: f64, measured_square_mm: Option<f64>| {
            let middle = Isometry3::translation(80.0, 60.0, 0.0);
            let turned = middle * Isometry3::rotation(Vector3::z() * turn_deg.to_radians()) * middle.inverse();
            let base_from_board =
                Rigid::from_isometry_unchecked(Isometry3::translation(500.0 + x_mm, 0.0, 0.0) * turned);
            uninformative_measurement(
                &known,
                &BoardMeasurement { base_from_board, pnp_rms_px, measured_square_mm },
                &board,
            )
        };
        for (kept, refused, words) in [
            (look(99.0, 0.0, 0.1, None), look(101.0, 0.0, 0.1, None), "101 mm from its expected position"),
            (look(0.0, 19.0, 0.1, None), look(0.0, 21.0, 0.1, None), "rotated by 21°"),
            (look(0.0, 0.0, 0.9, None), look(0.0, 0.0, 1.1, None), "1.10 px rms"),
            (look(0.0, 0.0, 0.1, Some(40.7)), look(0.0, 0.0, 0.1, Some(40.9)), "squares of 40.90 mm"),
            (look(0.0, 0.0, 0.1, Some(39.3)), look(f64::NAN, 0.0, 0.1, None), "unknown mm"),
        ] {
            let reason = refused.expect(words);
            assert!(kept.is_none(), "{words}: {kept:?}");
            assert!(reason.code == "implausible" && reason.message.contains(words), "{reason:?}");
        }
    }

    /// Expected value, calculated by hand: if the touched corners of a board with squares of 40 mm are 0.5 % farther
    /// apart, the squares measure 40.2 mm.
    #[test]
    fn touched_corners_determine_the_size_of_the_squares() {
        let board = Board::parse("5x4", 40.0).expect("a board");
        let corners = [[0.0, 0.0], [160.0, 0.0], [160.0, 120.0]];
        let touched = corners.map(|[x, y]| (Point::at(x, y, 0.0), Point::at(500.0 + 1.005 * x, 1.005 * y, 100.0)));
        let square_mm = square_size_from_touches(&board, &touched).expect("three corners");
        assert!((square_mm - 40.2).abs() < 1e-9, "{square_mm}");
        assert_eq!(square_size_from_touches(&board, &touched[..1]), None);
    }

    /// Expected value, calculated by hand: if the board is rotated by 0.01 rad about its origin, a corner 100 mm away
    /// has an error of 1 mm.
    #[test]
    fn the_error_is_that_of_the_farthest_corner() {
        let known: Rigid<Base, BoardFrame> =
            Rigid::from_isometry_unchecked(Isometry3::translation(500.0, 0.0, 0.0));
        let found = known * Rigid::from_isometry_unchecked(Isometry3::rotation(Vector3::z() * 0.01));
        let corners = [[0.0, 0.0], [100.0, 0.0], [0.0, 60.0]].map(|[x, y]| Point::at(x, y, 0.0));
        assert!((distance_mm(&known, &found, &corners) - 1.0).abs() < 1e-4);
    }
}
