//! `panelprep calibrate hand-eye`: determines the mount of a camera from many poses (`--poses`), or from three touched
//! points (`--image [--points]`).

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::output::Outcome;
use super::args::{HandEye as Args, MountName};
use super::arm_correction::{CorrectionInUse, read_cell_if_present, read_intrinsics};
use super::boards::{self, BoardImage};
use super::files;
use super::output::{self, provenance, write_calibration};
use panelprep_base::geometry::{Base, Frame, KukaPose, PinholeCamera, Point, Rigid};
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::{FlangeCameraMount, MountedPose, ScannerMount};
use panelprep_service::report;
use panelprep_vision::calib::board_orientation::resolve_symmetry;
use panelprep_vision::calib::detect::DetectedCorners;
use panelprep_vision::calib::gate::{self, PoseSource};
use panelprep_vision::calib::hand_eye::{MIN_STATIONS, hand_eye};
use panelprep_vision::calib::mounted::{self, Mounted};
use panelprep_vision::calib::three_points::{ThreePoints, three_points};
use panelprep_vision::calib::{
    Arrangement, Board, BoardObservation, CalibError, HandEye, Station, suggest_next_pose,
};
use panelprep_vision::locate::ScanErrors;
use rayon::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Calibrates the mount of a camera from many poses and writes the file.
///
/// # Errors
/// If a file is invalid, or the poses do not determine a mount.
pub fn run(args: &Args, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    match args.mount {
        MountName::EyeToHand => stage::<ScannerMount>(args, common, progress),
        MountName::EyeInHand => stage::<FlangeCameraMount>(args, common, progress),
    }
}

/// A picture that shows the board, and the pose that the robot reported.
struct BoardPicture {
    board_image: BoardImage,
    detected: DetectedCorners,
    base_from_flange: Rigid<Base, panelprep_base::geometry::Flange>,
    /// Whether the pose includes axis angles; then the controller reported it.
    has_axes: bool,
}

impl BoardPicture {
    /// Returns the corners as the 3D camera measured them, if it measured most of them.
    fn points<A: Mounted>(&self, camera: (&PinholeCamera, &ScanErrors)) -> Option<BoardObservation<A::From>> {
        let seen = self.board_image.measured(camera, &self.detected)?;
        mounted::points_of_most::<A>(seen, self.detected.corners.len())
    }
}

fn stage<A: Mounted>(args: &Args, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let board = boards::parse_board(&args.board)?;
    let lens = read_intrinsics(&args.intrinsics)?;
    let (camera, errors) = (lens.camera, ScanErrors::from_measured(lens.errors.as_ref()));
    let cell = read_cell_if_present(common)?;
    let arm = CorrectionInUse::load(args.robot.as_deref(), common)?;
    let (mut looks, aside) = collect_board_pictures(args, (&board, arm.as_ref()), &camera, progress)?;
    let mut pictures: Vec<_> =
        looks.iter_mut().map(|look| (look.base_from_flange, &mut look.detected.corners)).collect();
    resolve_symmetry::<A>(&camera, &board, &mut pictures).map_err(Fault::stage)?;
    let stations: Vec<Station<A::From>> = looks
        .iter()
        .map(|look| make_station(look, BoardObservation::Pixels(look.detected.corners.clone())))
        .collect();
    progress("mount");
    let calibrated =
        |stations: &[Station<A::From>], at| hand_eye::<A>(&camera, &board, stations, at).map_err(Fault::stage);
    let mut found = match hand_eye::<A>(&camera, &board, &stations, None) {
        Ok(found) => found,
        Err(error @ CalibError::Radians { .. }) => return Err(Fault::stage(error)),
        Err(error) => return Ok(refused(&error, &args.out)),
    };
    if let Some([x, y, z]) = args.at_mm {
        let Some(at) = A::point_in_camera(&found.adjustment.to_from_camera, Point::at(x, y, z)) else {
            let error = CalibError::Points(
                "--at-mm is a point in the robot's base: use this option only with a fixed camera".to_owned(),
            );
            return Err(Fault::stage(error));
        };
        found = calibrated(&stations, Some(at))?;
    }
    if let Some(covariance) = &lens.covariance {
        found = found.with_lens_uncertainty(&camera, &stations, covariance).map_err(Fault::stage)?;
    }
    let (with_points, measured): (Vec<&BoardPicture>, Vec<Station<A::From>>) = looks
        .iter()
        .filter_map(|look| Some((look, make_station(look, look.points::<A>((&camera, &errors))?))))
        .unzip();
    let second = match measured.len() >= MIN_STATIONS {
        true => Some(calibrated(&measured, Some(found.stated_point))?),
        false => None,
    };
    let has_scans = looks.iter().any(|look| look.board_image.cloud().is_some());
    let rough = cell.as_ref().and_then(A::rough_pose);
    // A pose without axis angles was typed by a person, even in a live session.
    let is_reported = args.live.live.is_some() && looks.iter().all(|look| look.has_axes);
    let poses = if is_reported { PoseSource::Controller } else { PoseSource::File };
    let judgement = gate::judge_hand_eye((&found, board.square_mm()), second.as_ref(), rough.as_ref(), poses);
    let mut outcome = Outcome::from_judgement(&judgement);
    report_result(&mut outcome, (&found, &board), &aside);
    // A cycle uses the points of the 3D camera, so the mount is computed from the points if there are any. The mount
    // from the pictures is then only a check.
    let kept = second.as_ref().unwrap_or(&found);
    outcome.add_value(A::TABLE, json!(to_kuka_pose(kept)));
    outcome.add_value("uncertainty_mm", json!(kept.uncertainty_mm));
    if let Some(second) = &second {
        let apart_mm = gate::position_difference_mm(&found, second);
        outcome.add_value(
            "second",
            json!({(A::TABLE): to_kuka_pose(second), "apart_mm": apart_mm, "uncertainty_mm": second.uncertainty_mm}),
        );
        outcome.add_line(format!(
            "mount from the 3D camera's own points (this mount is used): {} ± {:.3} mm ({apart_mm:.3} mm from the mount \
             by pictures, at the panel)",
            to_kuka_pose(second),
            second.uncertainty_mm
        ));
    }
    if second.is_none() && has_scans {
        outcome.add_line(format!(
            "the mount by pictures is used: the 3D camera's points show the board in {} shots, at least {MIN_STATIONS} are needed",
            measured.len()
        ));
    }
    if let Some(rough) = rough {
        let apart_mm = rough.distance_at_mm(found.adjustment.to_from_camera, Point::at(0.0, 0.0, 0.0));
        outcome.add_line(format!("distance from the rough mount in the cell's file: {apart_mm:.0} mm"));
    }
    if let Some(next) = suggest_next_pose(&camera, &board, &stations, &found) {
        outcome.add_value("next_pose", json!(next.base_from_flange));
        outcome.add_value("next_uncertainty_mm", json!(next.uncertainty_mm));
        let text = format!(
            "one more pose at {} would reduce the uncertainty most: to ± {:.3} mm",
            next.base_from_flange, next.uncertainty_mm
        );
        outcome.add_line(text);
    }
    let mut mounted = MountedPose::<A>::from_pose(to_kuka_pose(kept));
    mounted.date = output::today_utc();
    mounted.serial = args.serial.clone();
    mounted.robot_correction = arm.map(|arm| arm.hash);
    mounted.rms_mm = Some(kept.rms_mm);
    mounted.uncertainty_mm = Some(kept.uncertainty_mm);
    let of_kept: Vec<&BoardPicture> = if second.is_some() { with_points } else { looks.iter().collect() };
    let used = of_kept.into_iter().zip(&kept.residuals).filter(|(_, residual)| residual.used);
    let (hashes, residuals) =
        used.map(|(look, residual)| (look.board_image.hash.clone(), residual.distance_mm)).unzip();
    mounted.provenance = provenance(hashes, residuals);
    let text = mounted.to_toml();
    MountedPose::<A>::check(&args.out.display().to_string(), &text)?;
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

/// Returns the outcome for poses that do not determine a mount.
fn refused(error: &CalibError, out: &Path) -> Outcome {
    let reason = Reason::new("no_mount", error.to_string());
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![reason], vec![]));
    outcome.add_line(format!("{}: not written", out.display()));
    outcome
}

fn to_kuka_pose<A: Arrangement>(found: &HandEye<A>) -> KukaPose {
    KukaPose::from_rigid(&found.adjustment.to_from_camera)
}

fn make_station<C: Frame>(look: &BoardPicture, seen: BoardObservation<C>) -> Station<C> {
    Station { name: look.board_image.name.clone(), base_from_flange: look.base_from_flange, observation: seen }
}

/// Returns the pictures that show the board, and for each other picture the reason why it is not used.
fn collect_board_pictures(
    args: &Args,
    (board, arm): (&Board, Option<&CorrectionInUse>),
    camera: &PinholeCamera,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<(Vec<BoardPicture>, Vec<(String, String)>), Fault> {
    let (Some(file), Some(folder)) = (&args.poses, &args.images) else {
        return Err(Fault::stage(CalibError::Points("give --poses and --images together".to_owned())));
    };
    let is_there = |image: &str| folder.join(image).is_file();
    let poses = files::picture_poses(&file.display().to_string(), &disk::read_text(file)?, &is_there)?;
    let (window, done) = (boards::window(&args.board), AtomicUsize::new(0));
    let look = |pose: &files::PicturePose| {
        let board_image = BoardImage::read(&folder.join(&pose.image), camera)?;
        let found = board_image.detect(board, window);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(&format!("corners: {done} of {}", poses.len()));
        let base_from_flange = match arm {
            None => pose.base_from_flange,
            Some(arm) => arm.flange((file, &pose.image), pose.base_from_flange, pose.joints.as_ref())?,
        };
        Ok(found.map_err(|error| (pose.image.clone(), error.to_string())).map(|detected| BoardPicture {
            board_image,
            detected,
            base_from_flange,
            has_axes: pose.joints.is_some(),
        }))
    };
    let all: Vec<Result<BoardPicture, (String, String)>> =
        poses.par_iter().map(look).collect::<Result<_, Fault>>()?;
    let (mut looks, mut aside) = (Vec::new(), Vec::new());
    for found in all {
        match found {
            Ok(look) => looks.push(look),
            Err(reason) => aside.push(reason),
        }
    }
    if looks.len() < MIN_STATIONS {
        let first_reason = aside.first().map(|(_, reason)| reason.clone());
        let (found, given) = (looks.len(), poses.len());
        return Err(Fault::stage(CalibError::TooFewPictures { found, given, needed: MIN_STATIONS, first_reason }));
    }
    Ok((looks, aside))
}

fn report_result<A: Arrangement>(
    outcome: &mut Outcome,
    (found, board): (&HandEye<A>, &Board),
    aside: &[(String, String)],
) {
    let noise = &found.adjustment.noise;
    let turn_deg = noise.turn_rad.to_degrees();
    outcome.add_value(A::TABLE, json!(to_kuka_pose(found)));
    let residuals = found.residuals.iter().map(|residual| {
        json!({
            "file": residual.name, "mm": residual.distance_mm, "deg": residual.angle_deg, "used": residual.used,
            "corners_rms_px": residual.corners_rms,
        })
    });
    outcome.add_value("residuals", residuals.collect());
    let aside_json = aside.iter().map(|(file, reason)| json!({"file": file, "reason": reason}));
    outcome.add_value("set_aside", aside_json.collect());
    outcome.add_value("rms_mm", json!(found.rms_mm));
    outcome.add_value("rms_deg", json!(found.rms_deg));
    outcome.add_value("uncertainty_mm", json!(found.uncertainty_mm));
    outcome.add_value("picture_uncertainty_mm", json!(found.uncertainty_mm));
    outcome.add_value("poses_each", json!(found.correlated_pose_count));
    let lens_mm = found.lens_uncertainty_mm();
    outcome.add_value("lens_uncertainty_mm", json!(lens_mm));
    if let Some(size) = &found.square {
        let (square_mm, known_mm) = (size.ratio * board.square_mm(), size.ratio_95() * board.square_mm());
        outcome.add_value("square_mm", json!(square_mm));
        outcome.add_value("square_uncertainty_mm", json!(known_mm));
    }
    let (left_out_mm, left_out) = &found.worst_leave_one_out;
    outcome.add_value("leave_one_out_mm", json!(left_out_mm));
    outcome.add_value("second_axis_deg", json!(found.second_axis_deg));
    outcome
        .add_value("noise", json!({"corner_px": noise.corner, "robot_mm": noise.shift_mm, "robot_deg": turn_deg}));
    outcome.add_line(format!("{} {}", A::TABLE, to_kuka_pose(found)));
    let lens = match lens_mm > 0.0 {
        true => format!("the lens contributes ± {lens_mm:.3} mm"),
        false => "the intrinsics' file states no covariance: the lens is assumed to have no error".to_owned(),
    };
    outcome.add_line(format!("uncertainty ± {:.3} mm at the panel (95 %); {lens}", found.uncertainty_mm));
    if found.correlated_pose_count > 1.0 {
        outcome.add_line(format!(
            "the arm's errors are correlated in neighbouring poses: {:.1} poses count as one; calibrate the arm \
             (`panelprep calibrate robot`), or take poses over the whole working volume",
            found.correlated_pose_count
        ));
    }
    outcome.add_line(format!(
        "residuals between pictures and robot {:.3} mm and {:.4}° rms; estimated noise: corners {:.3} px, robot {:.3} mm and {turn_deg:.4}°",
        found.rms_mm, found.rms_deg, noise.corner, noise.shift_mm
    ));
    if let Some(size) = &found.square {
        let (mm, known_mm) = (size.ratio * board.square_mm(), size.ratio_95() * board.square_mm());
        outcome.add_line(format!(
            "side of the board's squares by the robot's motions: {mm:.3} ± {known_mm:.3} mm, stated {} mm",
            board.square_mm()
        ));
    }
    outcome.add_line(format!(
        "if the worst picture, {left_out}, is excluded, the result changes by {left_out_mm:.3} mm"
    ));
    for residual in &found.residuals {
        let mark = if residual.used { "" } else { "  does not fit" };
        outcome.add_line(format!(
            "  {}: {:.3} mm, {:.4}°{mark}",
            residual.name, residual.distance_mm, residual.angle_deg
        ));
    }
    if gate::are_outliers_acceptable(found) {
        found.suspects.iter().for_each(|suspect| outcome.add_line(format!("excluded: {suspect}")));
    }
    for (file, reason) in aside {
        outcome.add_line(format!("excluded: {file}: {reason}"));
    }
}

/// Writes a picture of the corners to be touched; with `--points`, calibrates the mount and writes the file.
///
/// # Errors
/// If a file is invalid, the picture shows no board, or the points do not determine a frame.
pub fn run_with_three_points(
    args: &Args,
    common: &Common,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Outcome, Fault> {
    match args.mount {
        MountName::EyeToHand => stage_of_three_points::<ScannerMount>(args, common, progress),
        MountName::EyeInHand => stage_of_three_points::<FlangeCameraMount>(args, common, progress),
    }
}

fn stage_of_three_points<A: Mounted>(
    args: &Args,
    common: &Common,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Outcome, Fault> {
    let board = boards::parse_board(&args.board)?;
    let camera = read_intrinsics(&args.intrinsics)?.camera;
    let Some(image) = &args.image else {
        return Err(Fault::stage(CalibError::Points(
            "--image is missing: give the picture of the board".to_owned(),
        )));
    };
    let board_image = BoardImage::read(image, &camera)?;
    let detected =
        board_image.detect_and_report(&board, boards::window(&args.board), progress).map_err(Fault::stage)?;
    let read = |file: &PathBuf| -> Result<files::Points, Fault> {
        Ok(files::points(&file.display().to_string(), &disk::read_text(file)?)?)
    };
    let mut points = args.points.as_ref().map(read).transpose()?;
    let arm = CorrectionInUse::load(args.robot.as_deref(), common)?;
    if let (Some(arm), Some(file), Some(points)) = (&arm, &args.points, &mut points) {
        arm.correct_tips(file, points)?;
    }
    let to_touch = match &points {
        Some(points) => points.touched.iter().map(|touched| touched.corner).collect(),
        None => board.corners_to_touch().to_vec(),
    };
    let drawn = report::draw_corners_to_touch(&board_image.color(), &board, &detected.corners, &to_touch)
        .map_err(Fault::stage)?;
    let beside = args.out.parent().unwrap_or(Path::new("")).to_owned();
    let picture = disk::save_picture(args.pictures.as_ref().unwrap_or(&beside), "corners_to_touch", &drawn)?;
    let Some(points) = points else {
        let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
        outcome.add_line(format!("{}: touch the corners in their order, 1 to 4", picture.display()));
        for (index, (column, row)) in to_touch.iter().enumerate() {
            outcome.add_line(format!("  point {}: p{}_corner = [{column}, {row}]", index + 1, index + 1));
        }
        outcome.add_value("picture", json!(picture));
        outcome.add_value("corners", json!(to_touch));
        return Ok(outcome);
    };
    let seen = BoardObservation::Pixels(detected.corners.clone());
    let found = three_points::<A>(&camera, &board, &seen, &points.touched, points.base_from_flange);
    let found = found.map_err(Fault::stage)?;
    let rough = read_cell_if_present(common)?.as_ref().and_then(A::rough_pose);
    let judgement = gate::three_points(&found, rough.as_ref());
    let mut outcome = build_outcome(&judgement, &found);
    outcome.add_value("picture", json!(picture));
    let mut mounted = MountedPose::<A>::from_pose(KukaPose::from_rigid(&found.to_from_camera));
    mounted.date = output::today_utc();
    mounted.serial = args.serial.clone();
    mounted.robot_correction = arm.map(|arm| arm.hash);
    // Three points have no residuals, so the file states neither a residual nor an uncertainty.
    mounted.provenance = provenance(vec![board_image.hash.clone()], vec![]);
    let text = mounted.to_toml();
    MountedPose::<A>::check(&args.out.display().to_string(), &text)?;
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

fn build_outcome<A: Mounted>(judgement: &Judgement, found: &ThreePoints<A>) -> Outcome {
    let mut outcome = Outcome::from_judgement(judgement);
    let pose = KukaPose::from_rigid(&found.to_from_camera);
    outcome.add_value(A::TABLE, json!(pose));
    outcome.add_value("pnp_rms_px", json!(found.pnp_rms_px));
    outcome.add_value("distance_errors_mm", json!(found.distance_errors_mm));
    outcome.add_value("check_mm", json!(found.check_mm));
    outcome.add_line(format!("{} {pose}", A::TABLE));
    let [first, second, third] = found.distance_errors_mm;
    outcome.add_line(format!(
        "corners {:.3} px rms; errors of the distances 1–2 {first:+.3}, 2–3 {second:+.3}, 1–3 {third:+.3} mm",
        found.pnp_rms_px
    ));
    if let Some(check_mm) = found.check_mm {
        outcome.add_line(format!("the fourth point deviates by {check_mm:.3} mm"));
    }
    outcome
}
