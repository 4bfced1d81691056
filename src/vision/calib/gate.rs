//! The acceptance checks of calibrations: derive a verdict from the evidence. A calibration may be used, must be
//! checked by a person, or is refused.

use super::chain::Arrangement;
use super::error::PoseReading;
use super::hand_eye::HandEye;
use super::intrinsics::Calibrated;
use super::lens_support::MAX_LENS_ERROR_PX;
use super::robot::RobotFound;
use super::three_points::ThreePoints;
use super::tool::{ToolAxis, ToolPoint};
use panelprep_base::geometry::{Point, Rigid};
use panelprep_base::number_text::{distinguishable_percents, distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Judgement, Reason};

/// Two limits of a value: beyond the first a person must check, beyond the second the calibration is rejected.
type ReviewAndRejectLimits = (f64, f64);

const HAND_EYE_UNCERTAINTY_LIMITS_MM: ReviewAndRejectLimits = (0.6, 2.0);
const HAND_EYE_RMS_LIMITS_MM: ReviewAndRejectLimits = (1.0, 3.0);
/// Limits of the panel's displacement, mm, if the squares had the size that the robot's motions show: beyond the first
/// a person must check, beyond the second the mount is rejected.
const SQUARE_EFFECT_LIMITS_MM: ReviewAndRejectLimits = (0.1, 0.5);
/// Maximum relative uncertainty of the size of the squares; with a larger one, a wrong size would not be detected: 2 mm
/// at 700 mm.
const MAX_RELATIVE_SQUARE_UNCERTAINTY: f64 = 0.003;
const REVIEW_SPREAD_DEG: f64 = 8.0;
const REVIEW_POSE_COUNT: usize = 10;
const DISTANCE_ERROR_LIMITS_MM: ReviewAndRejectLimits = (0.5, 1.5);
const PNP_RMS_LIMITS_PX: ReviewAndRejectLimits = (0.5, 2.0);
const FOURTH_POINT_ERROR_LIMITS_MM: ReviewAndRejectLimits = (0.5, 1.5);
const MAX_ROUGH_DISTANCE_MM: f64 = 150.0;
const MAX_ROUGH_ANGLE_DEG: f64 = 20.0;
const TOOL_RMS_LIMITS_MM: ReviewAndRejectLimits = (0.4, 1.5);
const AXIS_SCATTER_LIMITS_DEG: ReviewAndRejectLimits = (0.5, 2.0);
const INTRINSICS_RMS_LIMITS_PX: ReviewAndRejectLimits = (0.7, 2.0);
const MIN_COVERAGE_FRACTION: f64 = 0.6;
const MIN_TILT_DEG: f64 = 20.0;
const REVIEW_VIEW_COUNT: usize = 8;
/// Limits of the fraction of the picture in which the lens must be calibrated: below the first a person must check,
/// below the second the lens is rejected.
const SUPPORTED_FRACTION_LIMITS: ReviewAndRejectLimits = (0.95, 0.1);
/// Maximum standard deviation of the focal length, relative to the focal length: 0.1 % is 0.8 mm at 800 mm.
const MAX_RELATIVE_FOCAL_STD: f64 = 0.001;
/// Maximum standard deviation of the principal point, relative to the focal length: 0.2 mm of lateral shift at 1 m.
const MAX_RELATIVE_CENTRE_STD: f64 = 0.000_2;

/// Limits of the fraction of the error that remains with a correction: beyond the first a person must check, beyond the
/// second the correction does not help.
const REMAINING_ERROR_FRACTION_LIMITS: ReviewAndRejectLimits = (0.6, 0.9);
const LEFT_OUT_ERROR_LIMITS_MM: ReviewAndRejectLimits = (0.5, 2.0);
const REVIEW_ARM_VIEW_COUNT: usize = 24;

#[derive(Default)]
struct ReasonCollector {
    rejections: Vec<Reason>,
    reviews: Vec<Reason>,
}

impl ReasonCollector {
    /// Adds a reason if the value is beyond one of its limits; a NaN is beyond every limit.
    fn check_bounds(
        &mut self,
        code: &'static str,
        value: f64,
        (review, reject): ReviewAndRejectLimits,
        words: &str,
    ) {
        let message = |allowed: f64| {
            let [value, allowed] = distinguishable_texts(value, allowed, 3);
            format!("{words}: {value} (limit {allowed})")
        };
        if value.is_nan() || value > reject {
            self.rejections.push(Reason::new(code, message(reject)));
        } else if value > review {
            self.reviews.push(Reason::new(code, message(review)));
        }
    }

    fn add_review(&mut self, code: &'static str, doubtful: bool, message: impl FnOnce() -> String) {
        if doubtful {
            self.reviews.push(Reason::new(code, message()));
        }
    }

    /// Rejects a mount that is far from its hand-measured pose: it is then not the mount that was measured.
    fn check_rough_pose<A: Arrangement>(
        &mut self,
        rough: Option<&Rigid<A::To, A::From>>,
        found: &Rigid<A::To, A::From>,
        question: &str,
    ) {
        // Without a hand-measured pose there is nothing to compare; the reason `no_rough` requests a measurement.
        let Some(rough) = rough else { return };
        let mm = rough.distance_at_mm(*found, Point::at(0.0, 0.0, 0.0));
        let deg = (rough.inverse() * *found).rotation_angle().0;
        // The limits are wide, because a tape measure is accurate only to about 100 mm here. The error to detect, poses
        // that include a tool or a base frame, moves the mount by more.
        if mm > MAX_ROUGH_DISTANCE_MM || deg > MAX_ROUGH_ANGLE_DEG {
            let ([mm, allowed_mm], [deg, allowed_deg]) = (
                distinguishable_texts(mm, MAX_ROUGH_DISTANCE_MM, 0),
                distinguishable_texts(deg, MAX_ROUGH_ANGLE_DEG, 0),
            );
            let message = format!(
                "the calibrated camera is {mm} mm and {deg}° away from its approximate pose in the cell's file (limits \
                 {allowed_mm} mm and {allowed_deg}°); {question}"
            );
            self.rejections.push(Reason::new("rough_mount", message));
        }
    }

    /// Compares the size of the board's squares that the robot's motions show with the stated size.
    fn check_square<A: Arrangement>(&mut self, found: &HandEye<A>, square_mm: f64) {
        let (Some(size), Some(moves_mm)) = (&found.square, found.square_moves_mm()) else {
            return self.add_review("square_unproven", true, || {
                "the poses do not determine the size of the board's squares: a wrong --square-mm would not be \
                 detected; take poses that move the board farther"
                    .to_owned()
            });
        };
        if size.contradicts_stated() && (moves_mm > SQUARE_EFFECT_LIMITS_MM.0 || moves_mm.is_nan()) {
            let (mm, known_mm) =
                (fixed_decimals(size.ratio * square_mm, 3), fixed_decimals(size.ratio_95() * square_mm, 3));
            let message = format!(
                "according to the robot's motions, the board's squares measure {mm} ± {known_mm} mm, but the \
                 stated side is {square_mm} mm, which moves the mount by {} mm at the panel: measure the squares \
                 over the whole board and correct --square-mm; if they are right, the lens's focal length or the \
                 arm's lengths are wrong",
                fixed_decimals(moves_mm, 2)
            );
            let reason = Reason::new("square_size", message);
            if moves_mm > SQUARE_EFFECT_LIMITS_MM.1 {
                self.rejections.push(reason)
            } else {
                self.reviews.push(reason)
            }
        }
        let known = size.ratio_95();
        let is_uncertain = known.is_nan() || known > MAX_RELATIVE_SQUARE_UNCERTAINTY;
        self.add_review("square_unproven", !size.contradicts_stated() && is_uncertain, || {
            let [known, wanted] = distinguishable_percents(known, MAX_RELATIVE_SQUARE_UNCERTAINTY, 2);
            format!(
                "the poses determine the size of the board's squares only to {known} % (limit {wanted} %): a wrong \
                 --square-mm would not be detected; take more poses that move the board by several hundred mm"
            )
        });
    }

    /// Compares the focal length that the robot's motions show with the focal length of the lens.
    fn check_focal<A: Arrangement>(&mut self, found: &HandEye<A>) {
        let (Some(focal), Some(moves_mm)) = (&found.focal, found.focal_moves_mm()) else { return };
        if !focal.contradicts_stated() || moves_mm <= SQUARE_EFFECT_LIMITS_MM.0 {
            return;
        }
        let (share, known) =
            (fixed_decimals(100.0 * (focal.ratio - 1.0), 2), fixed_decimals(100.0 * focal.ratio_95(), 2));
        let message = format!(
            "according to the robot's motions, the focal length is {share} ± {known} % longer than the lens's file \
             states, which moves the mount by {} mm at the panel: check that the file is of this camera at this \
             focus, and that its pictures are unchanged, not rectified. Calibrate the lens again",
            fixed_decimals(moves_mm, 2)
        );
        let reason = Reason::new("focal_length_differs", message);
        let much = moves_mm.is_nan() || moves_mm > SQUARE_EFFECT_LIMITS_MM.1;
        if much { self.rejections.push(reason) } else { self.reviews.push(reason) }
    }

    fn judgement(self) -> Judgement {
        Judgement::new(self.rejections, self.reviews)
    }
}

/// Judges whether the intrinsics are accurate enough.
pub fn intrinsics(found: &Calibrated) -> Judgement {
    let mut reasons = ReasonCollector::default();
    reasons.check_bounds(
        "rms_px",
        found.rms_px,
        INTRINSICS_RMS_LIMITS_PX,
        "difference between corners and camera model, rms, px",
    );
    if let Some(shape) = &found.board_shape {
        let message = format!(
            "the board is not flat, or its squares are not equal: the residual of the corners is {} px rms with \
             the board's own shape, {} px with a flat shape; the board is bowed by {} mm, and corners are up to {} \
             mm off their nominal positions. The error of the lens is larger than stated: glue the print onto \
             glass or an aluminium plate, or use another board, and take the pictures again",
            fixed_decimals(shape.fitted_rms_px, 3),
            fixed_decimals(shape.flat_px, 3),
            fixed_decimals(shape.bow_mm, 1),
            fixed_decimals(shape.max_in_plane_shift_mm, 2)
        );
        reasons.reviews.push(Reason::new("board_shape", message));
    }
    let used = found.views.iter().filter(|view| view.exclusion_reason.is_none()).count();
    reasons.add_review("few_pictures", used < REVIEW_VIEW_COUNT, || {
        format!("{used} pictures were used; take {REVIEW_VIEW_COUNT} or more")
    });
    reasons.add_review("coverage", found.coverage < MIN_COVERAGE_FRACTION, || {
        let [covered, needed] = distinguishable_percents(found.coverage, MIN_COVERAGE_FRACTION, 0);
        format!(
            "corners cover {covered} % of the picture, at least {needed} % are needed; take pictures with the \
             board in the picture's corners, too"
        )
    });
    let (share, error_px) = (found.support.share, found.support.error_px);
    let supported = |needed: f64| {
        let [share, needed] = distinguishable_percents(share, needed, 0);
        let [error, wanted] = distinguishable_texts(error_px, MAX_LENS_ERROR_PX, 2);
        let message = format!(
            "the lens is known to {error} px in {share} % of the picture, at least {needed} % with {wanted} px are \
             needed; measurements outside of that part are refused: take pictures with the board there"
        );
        Reason::new("support", message)
    };
    if share.is_nan() || share < SUPPORTED_FRACTION_LIMITS.1 {
        reasons.rejections.push(supported(SUPPORTED_FRACTION_LIMITS.1));
    } else if share < SUPPORTED_FRACTION_LIMITS.0 || error_px > MAX_LENS_ERROR_PX {
        reasons.reviews.push(supported(SUPPORTED_FRACTION_LIMITS.0));
    }
    let [low, high] = found.tilt_deg;
    reasons.add_review("tilt", high < MIN_TILT_DEG, || {
        let [high, needed] = distinguishable_texts(high, MIN_TILT_DEG, 0);
        format!(
            "the board was tilted by {}° to {high}°; tilt it by {needed}° and more in both directions, otherwise \
             focal length and distance cannot be separated",
            fixed_decimals(low, 0)
        )
    });
    let focal = (found.deviations[0] / found.camera.fx_px).max(found.deviations[1] / found.camera.fy_px);
    reasons.add_review("focal_length", focal.is_nan() || focal > MAX_RELATIVE_FOCAL_STD, || {
        let [known, wanted] = distinguishable_percents(focal, MAX_RELATIVE_FOCAL_STD, 2);
        format!(
            "the focal length is known only to {known} % (limit {wanted} %); take more pictures with the board \
                 tilted"
        )
    });
    let centre = (found.deviations[2] / found.camera.fx_px).max(found.deviations[3] / found.camera.fy_px);
    reasons.add_review("principal_point", centre.is_nan() || centre > MAX_RELATIVE_CENTRE_STD, || {
        let [known, wanted] = distinguishable_texts(centre * 1e3, MAX_RELATIVE_CENTRE_STD * 1e3, 2);
        format!(
            "the principal point is known only to {known} mm at 1 m (limit {wanted} mm), and a mount calibrated \
             with it has the same error; take more pictures in which the board fills the picture, tilted in both \
             directions"
        )
    });
    reasons.judgement()
}

/// The source of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseSource {
    /// A file: the tool and the base to which the poses refer are unknown.
    File,
    /// This program, from the flange pose in the robot's base that the controller reports.
    Controller,
}

/// Minimum number of pictures for each excluded outlier.
const PICTURES_PER_OUTLIER: usize = 10;

/// Returns whether the outliers may be excluded. A few outliers among many consistent pictures change nothing. If there
/// are more, a person must correct the cause; the majority does not decide.
pub fn are_outliers_acceptable<A: Arrangement>(found: &HandEye<A>) -> bool {
    let left_out = found.residuals.iter().filter(|residual| !residual.used).count().max(found.suspects.len());
    let used = found.residuals.iter().filter(|residual| residual.used).count();
    left_out <= found.residuals.len() / PICTURES_PER_OUTLIER && used >= REVIEW_POSE_COUNT
}

/// Judges whether the mount from many poses is accurate enough. Outlier pictures reject the mount, except for a few
/// among many. `second` is the result from the points of the 3D camera, which must be as accurate; `rough` is the
/// hand-measured pose of the camera in the cell's file.
pub fn judge_hand_eye<A: Arrangement>(
    (found, square_mm): (&HandEye<A>, f64),
    second: Option<&HandEye<A>>,
    rough: Option<&Rigid<A::To, A::From>>,
    poses: PoseSource,
) -> Judgement {
    let mut reasons = ReasonCollector::default();
    reasons.add_review("no_rough", rough.is_none() && poses == PoseSource::File, || {
        "poses that include a tool or a base frame fit as well as poses without them, and only a rough mount \
         reveals this error: measure the camera's position with a tape, to 100 mm, and state it in the cell's file \
         ([rough])"
            .to_owned()
    });
    let question = "check --mount, and check that these poses are base_from_flange without a tool";
    reasons.check_rough_pose::<A>(rough, &found.adjustment.to_from_camera, question);
    for reading in &found.readings {
        reasons.rejections.push(Reason::new("other_reading", reading.to_string()));
    }
    reasons.check_square(found, square_mm);
    reasons.check_focal(found);
    for (result, of_which) in [(Some(found), ""), (second, "from the 3D camera's own points: ")] {
        let Some(result) = result else { continue };
        reasons.check_fit(result);
        reasons.check_uncertainty(result, of_which);
    }
    if let Some(second) = second {
        let away = position_difference_mm(found, second);
        // The root sum of squares, because the errors of pictures and 3D points are independent.
        let allowed = found.uncertainty_mm.hypot(second.uncertainty_mm);
        if away.is_nan() || away > 2.0 * allowed {
            let [away_words, allowed_words] = distinguishable_texts(away, 2.0 * allowed, 3);
            let message = format!(
                "the 3D camera's own points give a mount that differs by {away_words} mm at the panel (limit \
                 {allowed_words} mm); check that the intrinsics are those of the camera that took the pictures, \
                 and check --square-mm"
            );
            let reason = Reason::new("second_result", message);
            let much = away.is_nan() || away > HAND_EYE_UNCERTAINTY_LIMITS_MM.0;
            if much { reasons.rejections.push(reason) } else { reasons.reviews.push(reason) }
        }
    }
    reasons.judgement()
}

impl ReasonCollector {
    /// Rejects outlier pictures, except for a few among many. If the squares or the focal length are rejected, they are
    /// the cause of the outliers.
    fn check_fit<A: Arrangement>(&mut self, found: &HandEye<A>) {
        if are_outliers_acceptable(found) {
            return;
        }
        for suspect in &found.suspects {
            self.rejections.push(Reason::new("does_not_fit", suspect.to_string()));
        }
        let left_out: Vec<&str> = found
            .residuals
            .iter()
            .filter(|residual| !residual.used)
            .map(|residual| residual.name.as_str())
            .collect();
        if found.suspects.is_empty() && self.rejections.is_empty() && !left_out.is_empty() {
            let (count, all) = (left_out.len(), found.residuals.len());
            let message = format!(
                "{count} of {all} pictures do not agree with the others and were excluded: {}; check their poses, or take \
                 them again",
                left_out.join(", ")
            );
            self.rejections.push(Reason::new("does_not_fit", message));
        }
    }

    /// Checks the uncertainty of a mount; each reason begins with `of_which`.
    fn check_uncertainty<A: Arrangement>(&mut self, found: &HandEye<A>, of_which: &str) {
        let words = |what: &str| format!("{of_which}{what}");
        self.check_bounds(
            "uncertainty",
            found.uncertainty_mm,
            HAND_EYE_UNCERTAINTY_LIMITS_MM,
            &words("uncertainty of the mount at the panel (95 %), mm"),
        );
        self.check_bounds(
            "rms_mm",
            found.rms_mm,
            HAND_EYE_RMS_LIMITS_MM,
            &words("difference between picture and robot, rms, mm"),
        );
        let spread = found.second_axis_deg;
        self.add_review("rotation", spread.is_nan() || spread < REVIEW_SPREAD_DEG, || {
            let [spread, needed] = distinguishable_texts(spread, REVIEW_SPREAD_DEG, 1);
            words(&format!(
                "the poses rotate by {spread}° about the second axis, at least {needed}° are needed: take \
                            more poses that tilt the flange about another axis"
            ))
        });
        let used = found.residuals.iter().filter(|residual| residual.used).count();
        self.add_review("few_poses", used < REVIEW_POSE_COUNT, || {
            words(&format!("{used} poses were used; take {REVIEW_POSE_COUNT} or more"))
        });
        let (left_out_mm, name) = &found.worst_leave_one_out;
        self.add_review("one_pose", *left_out_mm > found.uncertainty_mm.max(0.02), || {
            words(&format!(
                "without {name} the result moves by {left_out_mm:.3} mm, more than its uncertainty; check that \
                 picture"
            ))
        });
    }
}

/// Maximum relative error of the lengths of an arm.
const MAX_RELATIVE_LENGTH_ERROR: f64 = 0.003;

/// Returns why poses cannot be the start of an arm calibration: they have another meaning, or the squares of the board
/// have another size, which would cause wrong lengths of the arm.
pub fn starting_pose_problem<A: Arrangement>(found: &HandEye<A>, square_mm: f64) -> Option<String> {
    if let Some(reading) = found.readings.first() {
        return Some(reading.to_string());
    }
    let size = found.square.as_ref().filter(|size| size.contradicts_stated())?;
    ((size.ratio - 1.0).abs() > MAX_RELATIVE_LENGTH_ERROR).then(|| {
        format!(
            "according to the robot's motions, the board's squares measure {} ± {} mm, but the stated side is \
             {square_mm} mm, and no arm has lengths with an error this large: measure the squares over the whole \
             board and correct --square-mm",
            fixed_decimals(size.ratio * square_mm, 3),
            fixed_decimals(size.ratio_95() * square_mm, 3)
        )
    })
}

/// Returns the distance between the positions of the stated point according to two results, mm.
pub fn position_difference_mm<A: Arrangement>(first: &HandEye<A>, second: &HandEye<A>) -> f64 {
    first.adjustment.to_from_camera.distance_at_mm(second.adjustment.to_from_camera, first.stated_point)
}

/// Judges whether the mount from three points is credible. `rough` is the hand-measured pose of the camera in the
/// cell's file.
pub fn three_points<A: Arrangement>(found: &ThreePoints<A>, rough: Option<&Rigid<A::To, A::From>>) -> Judgement {
    let mut reasons = ReasonCollector::default();
    for (error, between) in found.distance_errors_mm.iter().zip(["1 and 2", "2 and 3", "1 and 3"]) {
        let words = format!("difference between the touched and the nominal distance of points {between}, mm");
        reasons.check_bounds("distance", error.abs(), DISTANCE_ERROR_LIMITS_MM, &words);
    }
    reasons.check_bounds(
        "pnp_rms_px",
        found.pnp_rms_px,
        PNP_RMS_LIMITS_PX,
        "difference between the board's corners and its pose, rms, px",
    );
    if let Some(check) = found.check_mm {
        reasons.check_bounds("check_point", check, FOURTH_POINT_ERROR_LIMITS_MM, "error of the fourth point, mm");
    }
    let unseen = found.check_mm.is_none() || found.is_symmetric;
    reasons.add_review("no_check_point", unseen && rough.is_none(), || match found.check_mm {
        None => "three touched points have no residual, so a board that was touched from another corner would not \
                 be detected; touch a fourth corner (p4) that is numbered in the picture, or state a rough mount in \
                 the cell's file ([rough])"
            .to_owned(),
        Some(_) => "the four touched corners are symmetric, so a board that was touched from its other end would \
                    not be detected; touch as the fourth corner (p4) one that breaks the symmetry and is numbered \
                    in the picture, or state a rough mount in the cell's file ([rough])"
            .to_owned(),
    });
    reasons.check_rough_pose::<A>(
        rough,
        &found.to_from_camera,
        "check that the touched corners are those that are numbered in the picture",
    );
    reasons.judgement()
}

/// Maximum error, in pictures not used for the fit, of an arm that needs no correction, mm.
const MAX_GOOD_ARM_ERROR_MM: f64 = 0.08;
/// Maximum error of an arm that needs no correction because no correction reduces the error, mm.
const MAX_NEGLIGIBLE_ARM_ERROR_MM: f64 = 0.15;

/// Returns whether the arm needs no correction: its nominal geometry is accurate, or nearly so and a correction does
/// not reduce the error. The remaining error is then the scatter of the pictures.
pub fn needs_no_correction(found: &RobotFound) -> bool {
    let (before, after) = (found.uncorrected_left_out_mm, found.corrected_left_out_mm);
    before < MAX_GOOD_ARM_ERROR_MM
        || (before < MAX_NEGLIGIBLE_ARM_ERROR_MM && after > REMAINING_ERROR_FRACTION_LIMITS.1 * before)
}

/// Judges whether the correction of the arm reduces the error enough to be used. `views` is the number of pictures.
pub fn robot(found: &RobotFound, views: usize) -> Judgement {
    let mut reasons = ReasonCollector::default();
    let (before, after) = (found.uncorrected_left_out_mm, found.corrected_left_out_mm);
    if needs_no_correction(found) {
        return reasons.judgement();
    }
    let share = after / before;
    if share.is_nan() || share > REMAINING_ERROR_FRACTION_LIMITS.1 {
        let message = format!(
            "the residual of left-out pictures is {before:.3} mm rms without a correction and {after:.3} mm with \
             it, so these data do not determine a correction of the arm; give axis angles with the poses, and more \
             poses that differ in every axis"
        );
        reasons.rejections.push(Reason::new("no_correction", message));
    }
    reasons.add_review("little_help", share > REMAINING_ERROR_FRACTION_LIMITS.0, || {
        let [share, wanted] = distinguishable_percents(1.0 - share, 1.0 - REMAINING_ERROR_FRACTION_LIMITS.0, 0);
        format!(
            "the correction reduces the error of left-out pictures by {share} %, at least {wanted} % are needed; \
             take more poses"
        )
    });
    reasons.check_bounds(
        "left_out_mm",
        after,
        LEFT_OUT_ERROR_LIMITS_MM,
        "error of left-out pictures with the correction, rms, mm",
    );
    reasons.add_review("few_pictures", views < REVIEW_ARM_VIEW_COUNT, || {
        format!("{views} pictures were used; take {REVIEW_ARM_VIEW_COUNT} or more, over the whole working volume")
    });
    reasons.judgement()
}

/// Judges whether the tool calibration is accurate enough. Without an axis the tool may be used to touch points, but
/// not to sand.
pub fn tool(point: &ToolPoint, axis: Option<&ToolAxis>, readings: &[PoseReading]) -> Judgement {
    let mut reasons = ReasonCollector::default();
    let fitting: Vec<String> = readings.iter().map(|reading| format!(" ({reading})")).collect();
    let words = format!("distance of the tip from the spot, rms, mm{}", fitting.join(""));
    reasons.check_bounds("rms_mm", point.rms_mm, TOOL_RMS_LIMITS_MM, &words);
    match axis {
        None => reasons.add_review("no_axis", true, || {
            "the tool's axis was not measured, so this tool is valid as a pointer, but refused for sanding; add \
             [[axis]], or [[plate]] and [[flat]]"
                .to_owned()
        }),
        Some(axis) => {
            let worst = axis.residuals_deg.iter().copied().fold(0.0, f64::max);
            reasons.check_bounds(
                "axis",
                worst,
                AXIS_SCATTER_LIMITS_DEG,
                "difference between the touches in the direction of the axis, \
                                                    degrees",
            );
            if let Some(rms_mm) = axis.plate_rms_mm {
                reasons.check_bounds("plate", rms_mm, TOOL_RMS_LIMITS_MM, "unevenness of the plate, rms, mm");
            }
        }
    }
    reasons.judgement()
}
