//! `panelprep calibrate robot`: determines the errors of the arm from pictures of boards and from touches.
//!
//! The report states the possible error of the TCP over the working volume, which pose to measure next, and whether a
//! further pose is useful.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::output::Outcome;
use super::args::Robot as Args;
use super::boards::{self, BoardImage};
use super::output::{self, provenance, write_calibration};
use super::{arm_correction, files};
use panelprep_base::geometry::{Base, Camera, KukaPose, PinholeCamera, Point, median};
use panelprep_cell::cell::{ArmGeometry, Cell, FlangeCameraMount, RobotCorrection, ScannerMount};
use panelprep_service::setup::SetupFault;
use panelprep_service::stages::arm_poses;
use panelprep_vision::calib::board_orientation::resolve_symmetry;
use panelprep_vision::calib::hand_eye::{MIN_STATIONS, hand_eye as mount_of};
use panelprep_vision::calib::robot::{
    self, ArmPose, ArmTouch, ArmView, Correction, Rig, RigKind, RobotData, RobotFound, TouchTarget,
};
use panelprep_vision::calib::robot_next::{self, NextPose};
use panelprep_vision::calib::{
    Arrangement, Board, BoardObservation, CalibError, Station, arm_errors, board_pose, gate,
};
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;

/// A picture that shows the board.
struct BoardPicture {
    board_image: BoardImage,
    corners: panelprep_vision::calib::detect::Corners,
    pose: ArmPose,
}

/// Estimates the errors of the arm and writes its correction.
///
/// # Errors
/// If a file is invalid.
pub fn run(args: &Args, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let cell = match arm_correction::read_cell_if_present(common)? {
        Some(cell) => cell,
        None => Cell::check("", "")?,
    };
    let geometry = *cell.arm().geometry();
    let mut data = RobotData { geometry, rigs: vec![], views: vec![], touches: vec![] };
    let mut aside = Vec::new();
    let mut hashes = Vec::new();
    let mut cameras = Vec::new();
    let rigs = [
        (RigKind::EyeToHand, &args.eye_to_hand, &args.scanner_lens),
        (RigKind::EyeInHand, &args.eye_in_hand, &args.flange_camera_lens),
    ];
    for (kind, poses, lens) in rigs {
        let (Some(poses), Some(lens)) = (poses, lens) else { continue };
        let camera = arm_correction::read_intrinsics(lens)?.camera;
        let mut looks = collect_board_views(args, (poses, &geometry), &camera, &mut aside, progress)?;
        let rig = data.rigs.len();
        let started = match kind {
            RigKind::EyeToHand => start::<ScannerMount>(args, kind, &camera, &mut looks),
            RigKind::EyeInHand => start::<FlangeCameraMount>(args, kind, &camera, &mut looks),
        };
        match started {
            Ok(started) => {
                data.rigs.push(started);
                cameras.push(camera);
            }
            Err(Fault::Setup(SetupFault::Stage(error))) => return Ok(refused("no_mount", error.to_string(), args)),
            Err(fault) => return Err(fault),
        }
        for look in looks {
            hashes.push(look.board_image.hash);
            let view = ArmView::from_corners(look.board_image.name, rig, look.pose, &camera, &look.corners);
            data.views.push(view.map_err(Fault::stage)?);
        }
    }
    if let Some(file) = &args.touches {
        data.touches = touches(args, file, &data, &cameras)?;
    }
    progress("arm");
    let found = match robot::calibrate(&data) {
        Ok(found) => found,
        Err(error) => return Ok(refused("no_arm", error.to_string(), args)),
    };
    let judgement = gate::robot(&found, data.views.len());
    let mut outcome = Outcome::from_judgement(&judgement);
    report_result(&mut outcome, &found, &aside);
    let board = boards::parse_board(&args.board)?;
    report_advice(&mut outcome, &cell, &found, (&data, &cameras, &board));
    if gate::needs_no_correction(&found) {
        outcome.add_line(format!("{}: not written, the arm needs no correction", args.out.display()));
        return Ok(outcome);
    }
    let file = RobotCorrection {
        numbers: found.correction.for_file(),
        left_out_before_mm: found.uncorrected_left_out_mm,
        left_out_after_mm: found.corrected_left_out_mm,
        date: output::today_utc(),
        provenance: provenance(hashes, vec![]),
    };
    write_calibration(&mut outcome, &judgement, &args.out, &file.to_toml())?;
    Ok(outcome)
}

/// Returns the outcome for data that do not determine the errors of the arm.
fn refused(code: &'static str, message: String, args: &Args) -> Outcome {
    let reason = panelprep_base::verdict::Reason::new(code, message);
    let mut outcome = Outcome::from_judgement(&panelprep_base::verdict::Judgement::new(vec![reason], vec![]));
    outcome.add_value("residual_left_out_mm", json!(null));
    outcome.add_value("residual_left_out_before_mm", json!(null));
    outcome.add_line(format!("{}: not written", args.out.display()));
    outcome
}

/// Reads the touches. A touched corner belongs to the fixed board of the flange camera, or to the board in a picture of
/// the fixed camera.
fn touches(args: &Args, file: &Path, data: &RobotData, cameras: &[PinholeCamera]) -> Result<Vec<ArmTouch>, Fault> {
    let board = boards::parse_board(&args.board)?;
    let folder = file.parent().unwrap_or(Path::new("."));
    let is_there = |image: &str| folder.join(image).is_file();
    let stated = files::arm_touches(&file.display().to_string(), &disk::read_text(file)?, &is_there)?;
    let wrong = |words: String| Fault::stage(CalibError::Points(format!("{}: {words}", file.display())));
    let rig = |kind: RigKind, option: &str| {
        let found = data.rigs.iter().position(|rig| rig.kind == kind);
        found.ok_or_else(|| {
            wrong(format!("the poses of the camera that saw a touched corner are missing; give {option}"))
        })
    };
    let corner = |column: usize, row: usize| {
        let (columns, rows) = (board.columns(), board.rows());
        let none = || wrong(format!("corner = [{column}, {row}] is not on the board of {columns}×{rows} corners"));
        board.corner(column, row).ok_or_else(none)
    };
    let mut looked = std::collections::BTreeMap::new();
    let mut all = Vec::with_capacity(stated.len());
    for (touched, pose) in stated {
        let at = match touched {
            files::StatedTouch::Spot(spot) => TouchTarget::Spot(spot),
            files::StatedTouch::Corner(column, row) => {
                TouchTarget::Corner { rig: rig(RigKind::EyeInHand, "--eye-in-hand")?, place: corner(column, row)? }
            }
            files::StatedTouch::CornerIn(column, row, image) => {
                let rig = rig(RigKind::EyeToHand, "--eye-to-hand")?;
                let seen = match looked.get(&image) {
                    Some(seen) => *seen,
                    None => {
                        let board_image = BoardImage::read(&folder.join(&image), &cameras[rig])?;
                        let found =
                            board_image.detect(&board, boards::window(&args.board)).map_err(Fault::stage)?;
                        let seen = board_pose::<Camera>(&cameras[rig], &BoardObservation::Pixels(found.corners));
                        let seen = seen.map_err(Fault::stage)?.camera_from_board;
                        looked.insert(image, seen);
                        seen
                    }
                };
                TouchTarget::Seen { rig, place: seen * corner(column, row)? }
            }
        };
        all.push(ArmTouch { target: at, pose: arm_pose(&pose, &data.geometry) });
    }
    Ok(all)
}

fn arm_pose(stated: &files::StatedPose, geometry: &ArmGeometry) -> ArmPose {
    let drawn = |joints| arm_errors::base_from_flange(geometry, joints, &[0.0; arm_errors::ARM_PARAMETER_COUNT]);
    match *stated {
        files::StatedPose::Flange(base_from_flange) => ArmPose { joints: None, base_from_flange },
        files::StatedPose::Axes(joints) => ArmPose { joints: Some(joints), base_from_flange: drawn(&joints) },
        files::StatedPose::Both(base_from_flange, joints) => ArmPose { joints: Some(joints), base_from_flange },
    }
}

fn collect_board_views(
    args: &Args,
    (file, geometry): (&Path, &ArmGeometry),
    camera: &PinholeCamera,
    aside: &mut Vec<(String, String)>,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Vec<BoardPicture>, Fault> {
    let board = boards::parse_board(&args.board)?;
    let folder = file.parent().unwrap_or(Path::new("."));
    let is_there = |image: &str| folder.join(image).is_file();
    let poses = files::arm_poses(&file.display().to_string(), &disk::read_text(file)?, &is_there)?;
    progress(&format!("{}: corners of {} pictures", file.display(), poses.len()));
    let look = |pose: &files::NamedPose| {
        let board_image = BoardImage::read(&folder.join(&pose.image), camera)?;
        let found = board_image.detect(&board, boards::window(&args.board));
        Ok(found.map_err(|error| (pose.image.clone(), error.to_string())).map(|detected| BoardPicture {
            board_image,
            corners: detected.corners,
            pose: arm_pose(&pose.pose, geometry),
        }))
    };
    let all: Vec<Result<BoardPicture, (String, String)>> =
        poses.par_iter().map(look).collect::<Result<_, Fault>>()?;
    Ok(all.into_iter().filter_map(|found| found.map_err(|reason| aside.push(reason)).ok()).collect())
}

/// Returns start values for mount and board, from the poses of the controller. The corners of all boards are numbered
/// in the same direction.
fn start<A: Arrangement>(
    args: &Args,
    kind: RigKind,
    camera: &PinholeCamera,
    looks: &mut [BoardPicture],
) -> Result<Rig, Fault> {
    let board = boards::parse_board(&args.board)?;
    let mut pictures: Vec<_> =
        looks.iter_mut().map(|look| (look.pose.base_from_flange, &mut look.corners)).collect();
    resolve_symmetry::<A>(camera, &board, &mut pictures).map_err(Fault::stage)?;
    let stations: Vec<Station<A::From>> = looks
        .iter()
        .map(|look| Station {
            name: look.board_image.name.clone(),
            base_from_flange: look.pose.base_from_flange,
            observation: BoardObservation::Pixels(look.corners.clone()),
        })
        .collect();
    if stations.len() < MIN_STATIONS {
        let (found, given) = (stations.len(), stations.len());
        let error = CalibError::TooFewPictures { found, given, needed: MIN_STATIONS, first_reason: None };
        return Err(Fault::stage(error));
    }
    let found = mount_of::<A>(camera, &board, &stations, None).map_err(Fault::stage)?;
    if let Some(words) = gate::starting_pose_problem(&found, board.square_mm()) {
        return Err(Fault::stage(CalibError::Points(words)));
    }
    Ok(Rig {
        kind,
        mount: *found.adjustment.to_from_camera.isometry(),
        board: *found.adjustment.holder_from_board.isometry(),
    })
}

fn report_result(outcome: &mut Outcome, found: &RobotFound, aside: &[(String, String)]) {
    outcome.add_value("residual_left_out_mm", json!(found.corrected_left_out_mm));
    outcome.add_value("residual_left_out_before_mm", json!(found.uncorrected_left_out_mm));
    let kind = match &found.correction {
        Correction::Geometry { .. } => "geometry".to_owned(),
        Correction::Smooth { middle_mm, half_mm, .. } => {
            let [[x0, x1], [y0, y1], [z0, z1]] =
                std::array::from_fn(|axis| [middle_mm[axis] - half_mm[axis], middle_mm[axis] + half_mm[axis]]);
            outcome.add_line(format!(
                "no axis angles: a smooth correction, valid within x {x0:.0} to {x1:.0}, y {y0:.0} to {y1:.0}, z {z0:.0} to {z1:.0} mm"
            ));
            "smooth".to_owned()
        }
    };
    outcome.add_value("kind", json!(kind));
    outcome.add_line(format!(
        "held-out pictures: residuals {:.3} mm rms with mounts and boards alone, {:.3} mm rms with the correction",
        found.uncorrected_left_out_mm, found.corrected_left_out_mm
    ));
    let numbers = found.numbers.iter().map(|number| {
        json!({"name": number.name, "value": number.value, "uncertainty": number.uncertainty, "untold": number.remaining_share})
    });
    outcome.add_value("parameters", numbers.collect());
    let (determined_numbers, undetermined): (Vec<_>, Vec<_>) =
        found.numbers.iter().partition(|number| number.remaining_share < robot_next::MAX_DETERMINED_STD_RATIO);
    for number in &determined_numbers {
        outcome.add_line(format!("  {} {:.4} ± {:.4}", number.name, number.value, number.uncertainty));
    }
    let names: Vec<&str> = undetermined.iter().map(|number| number.name.as_str()).collect();
    if !names.is_empty() {
        outcome.add_line(format!(
            "not determined by these data, so kept near the nominal values: {}",
            names.join("; ")
        ));
    }
    if let Some(tip) = found.tip_mm {
        outcome.add_value("tip_mm", json!([tip.x, tip.y, tip.z]));
    }
    outcome.add_value(
        "set_aside",
        aside.iter().map(|(file, reason)| json!({"file": file, "reason": reason})).collect(),
    );
    aside.iter().for_each(|(file, reason)| outcome.add_line(format!("excluded: {file}: {reason}")));
}

/// Reports the stated error over the working volume and the next pose.
fn report_advice(
    outcome: &mut Outcome,
    cell: &Cell,
    found: &RobotFound,
    (data, cameras, board): (&RobotData, &[PinholeCamera], &Board),
) {
    let volume = arm_poses::working_volume(cell, found, data);
    let mut stated: Vec<(f64, Point<Base>)> = volume
        .iter()
        .filter_map(|pose| Some((found.tip_uncertainty_mm(pose)?, (pose.base_from_flange * arm_poses::tip(found)))))
        .collect();
    stated.sort_by(|a, b| a.0.total_cmp(&b.0));
    outcome.add_value("tip_uncertainty_mm", json!(null));
    if let Some((worst_mm, at)) = stated.last().copied() {
        let mut all: Vec<f64> = stated.iter().map(|(mm, _)| *mm).collect();
        let median_mm = median(&mut all).unwrap_or(worst_mm);
        let (x, y, z) = (at.mm.x, at.mm.y, at.mm.z);
        let places = stated.len();
        outcome.add_value(
            "tip_uncertainty_mm",
            json!({"median": median_mm, "worst": worst_mm, "at_mm": [x, y, z], "places": places}),
        );
        outcome.add_line(format!(
            "error of the tip with the correction: at most {median_mm:.2} mm (95 %, median of {places} positions in \
             the working volume); at the worst position {worst_mm:.2} mm, at ({x:.0}, {y:.0}, {z:.0}) mm"
        ));
    }
    let candidates = arm_poses::candidates(cell, found, data, (cameras, board));
    let next = robot_next::best_next_pose(found, &candidates, &volume);
    outcome.add_value("next_pose", next.as_ref().map_or(json!(null), |next| object(found, next)));
    outcome.add_value("enough", json!(next.as_ref().map(NextPose::is_sufficient)));
    outcome.add_line(describe_advice(found, next.as_ref()));
}

fn describe_advice(found: &RobotFound, next: Option<&NextPose>) -> String {
    let Some(next) = next else {
        return "no next pose: no pose within the axis limits shows a whole board, or the data determine no parameter \
                yet"
            .to_owned();
    };
    let less = |share: f64| format!("{:.1} %", 100.0 * (1.0 - share));
    if next.is_sufficient() {
        return format!(
            "enough poses: no further pose reduces the tip's stated error by more than {}",
            less(next.tip_share)
        );
    }
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&next.pose.base_from_flange);
    let axes = next.pose.joints.map_or(String::new(), |joints| {
        let all: Vec<String> = joints.degrees().iter().map(|deg| format!("{deg:.1}")).collect();
        format!("axes [{}]°, ", all.join(", "))
    });
    format!(
        "next pose, for {}: {axes}flange X {x_mm:.1} Y {y_mm:.1} Z {z_mm:.1} A {a_deg:.1} B {b_deg:.1} C {c_deg:.1}; \
         the uncertainty of the least known parameter, {}, falls by {}; a further pose reduces the tip's stated error \
         by up to {}",
        describe_board(found, next.rig),
        next.weakest_parameter,
        less(next.weakest_share),
        less(next.tip_share)
    )
}

fn describe_board(found: &RobotFound, rig: usize) -> &'static str {
    match found.rigs[rig].kind {
        RigKind::EyeToHand => "the board on the flange in front of the fixed camera",
        RigKind::EyeInHand => "the fixed board in front of the camera on the flange",
    }
}

fn object(found: &RobotFound, next: &NextPose) -> serde_json::Value {
    let rig = match found.rigs[next.rig].kind {
        RigKind::EyeToHand => "eye-to-hand",
        RigKind::EyeInHand => "eye-in-hand",
    };
    json!({
        "board": rig,
        "axes_deg": next.pose.joints.map(|joints| joints.degrees()),
        "base_from_flange": KukaPose::from_rigid(&next.pose.base_from_flange),
        "improves": next.weakest_parameter,
        "improves_share": next.weakest_share,
        "tip_share": next.tip_share,
    })
}
