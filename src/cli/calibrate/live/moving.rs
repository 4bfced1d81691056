//! Chooses the poses of a calibration in which the arm moves automatically.
//!
//! A person moves the arm to a pose in which the camera sees the board. From this pose the flange is rotated about a
//! point at the board's distance and shifted, until enough pictures show the board for a first mount. After that, each
//! next pose is the one that reduces the stated error of the mount most, until a further pose would reduce it too
//! little. Each motion must pass the checks of `panelprep robot move-j`; a pose that does not pass is skipped.

use super::super::super::fault::{CalibrationFault, Fault};
use super::super::super::flange_pose::controller_pose;
use super::super::super::live;
use super::super::super::output::write_progress as tell;
use super::super::args::HandEye;
use super::super::boards;
use super::session::{self, CalibrationCamera, OperatorChoice, Session, suggest_next_pose};
use crate::cli::output::Outcome;
use panelprep_base::geometry::{self, Base, Flange, Joints, PinholeCamera, Point, Rigid};
use panelprep_cell::cell::RobotKind;
use panelprep_cell::files::ReportedFlange;
use panelprep_devices::cameras::BoardView;
use panelprep_service::daemon::{SingleError, SingleRobot};
use panelprep_service::setup::CellFiles;
use panelprep_toolpath::path::{Kinematics, reach};
use panelprep_vision::calib::{Board, BoardObservation, board_pose, detect, variation};

/// Speed of the automatic motions, % of the axes' maximum speed.
const AXIS_SPEED_PERCENT: u8 = 10;
/// Maximum number of pictures of one session.
const MAX_PICTURES: usize = 30;
/// Minimum number of pictures with the board for the first computation of the mount.
const MIN_FIRST_PICTURES: usize = 8;
/// Takes pictures from pose to pose.
///
/// # Errors
/// If the robot does not execute a motion, the camera delivers no picture, or writing to the disk fails.
pub fn run(
    (args, cell, kind): (&HandEye, &CellFiles, BoardView),
    (board, camera): (&Board, PinholeCamera),
    session: &mut Session<'_>,
    (so_far, progress): (&dyn Fn() -> Result<Outcome, Fault>, &(dyn Fn(&str) + Sync)),
) -> Result<(), Fault> {
    cell.require(panelprep_service::requirements::Purpose::Robot)?;
    let is_mock = cell.cell.robot().kind() == RobotKind::Mock;
    // The store is locked, because another program that uses it may be moving the robot.
    let _store = (!is_mock).then(|| cell.settled_store()).transpose()?;
    let starts = if is_mock { first_pose((args, cell, kind), board, camera)? } else { None };
    let (mut robot, simulated) = live::start_robot_at(&cell.cell, starts)?;
    let mut view = match &simulated {
        Some(simulated) if session::is_simulated(cell, kind) => {
            let arm = Some(simulated.server.handle());
            CalibrationCamera::simulated((kind, board), (&args.live, Some(camera)), arm)?
        }
        _ => CalibrationCamera::open(cell, (kind, board), (&args.live, Some(camera)), progress)?,
    };
    let single = SingleRobot::connect(&mut robot, cell.cell.arm()).map_err(Fault::stage)?;
    single.check_proofs(&cell.cell).map_err(Fault::stage)?;
    let mut single = single.with_mounted(cell.flange_devices()?);
    tell(&format!(
        "The arm will move by itself, at {AXIS_SPEED_PERCENT} % of its axes' speed, to up to {} poses around its \
         present pose. Make sure that the path is clear, and keep a hand on the enabling switch or the emergency stop.",
        session.max_pictures(MAX_PICTURES)
    ));
    if session.ask_for_picture()? == OperatorChoice::Done {
        return Ok(());
    }
    let mut tour = PoseTour { single: &mut single, cell, arm: Kinematics::new(cell.cell.arm()) };
    let first = tour.flange_pose()?.base_from_flange.to_rigid();
    take_board_picture(&mut view, &tour, session)?;
    let about_mm = distance_mm(&session.pictures(), kind, (&camera, board), args)?;
    let mut variations = variation::poses_around(first, about_mm);
    while session.picture_count() < session.max_pictures(MAX_PICTURES) {
        let known = if session.board_picture_count() >= MIN_FIRST_PICTURES { Some(so_far()?) } else { None };
        if known.as_ref().is_some_and(|known| !super::report_mount(known)) {
            return Ok(());
        }
        let proposed = known.as_ref().and_then(suggest_next_pose);
        let is_there = match proposed {
            Some(pose) => tour.move_to(&pose.to_rigid())?,
            None => false,
        };
        if !is_there {
            let Some(next) = variations.next() else {
                tell(
                    "no further pose: the remaining poses are out of the arm's reach or do not pass the motion checks",
                );
                return Ok(());
            };
            if !tour.move_to(&next)? {
                continue;
            }
        }
        take_board_picture(&mut view, &tour, session)?;
    }
    Ok(())
}

/// The motions of the arm between the poses of a session.
struct PoseTour<'t, 's> {
    single: &'t mut SingleRobot<'s>,
    cell: &'t CellFiles,
    arm: Kinematics,
}

impl PoseTour<'_, '_> {
    /// Returns the current flange pose, as the controller computes it.
    fn flange_pose(&self) -> Result<ReportedFlange, Fault> {
        controller_pose(&self.arm, &self.single.state().joints).ok_or(CalibrationFault::NoAxes.into())
    }

    /// Moves to this flange pose with the smallest motion of the axes. Returns false if the pose is out of reach, or
    /// the motion does not pass the checks.
    fn move_to(&mut self, base_from_flange: &Rigid<Base, Flange>) -> Result<bool, Fault> {
        let now = self.single.state().joints;
        let far_deg = |joints: &Joints| joints.max_difference_deg(&now);
        let mut ways = reach::postures(&self.arm, base_from_flange, Point::at(0.0, 0.0, 0.0));
        ways.sort_by(|a, b| far_deg(a).total_cmp(&far_deg(b)));
        let Some(joints) = ways.first().filter(|joints| far_deg(joints) < MAX_AXIS_ROTATION_DEG) else {
            tell("this pose is skipped: the arm cannot reach the pose, or only in another configuration");
            return Ok(false);
        };
        match self.single.move_joints(*joints, AXIS_SPEED_PERCENT, &self.cell.cell) {
            Ok(()) => Ok(true),
            Err(SingleError::Gate(judgement)) => {
                let why = judgement.reasons.first().map_or(String::new(), |reason| reason.message.to_string());
                tell(&format!("this pose is skipped: {why}"));
                Ok(false)
            }
            Err(error) => Err(Fault::stage(error)),
        }
    }
}

/// Maximum rotation of an axis to the next pose, degrees. With a larger rotation the arm would change its configuration
/// and sweep a large part of the cell.
const MAX_AXIS_ROTATION_DEG: f64 = 90.0;

fn take_board_picture(
    view: &mut CalibrationCamera,
    tour: &PoseTour<'_, '_>,
    session: &mut Session<'_>,
) -> Result<bool, Fault> {
    let (taken, _) = view.capture()?;
    session.store_picture(&taken, Some(&tour.flange_pose()?))
}

/// Returns the distance of the board along the flange's Z axis. If the camera is on the flange, it is the distance
/// between board and camera in the first picture. A board on the flange is rotated about the flange itself.
fn distance_mm(
    pictures: &[std::path::PathBuf],
    kind: BoardView,
    (camera, board): (&PinholeCamera, &Board),
    args: &HandEye,
) -> Result<f64, Fault> {
    if kind.is_fixed() {
        return Ok(0.0);
    }
    let Some(first) = pictures.first() else { return Ok(0.0) };
    let board_image = boards::BoardImage::read(first, camera)?;
    let found = detect::detect(&board_image.name, &board_image.gray, board, boards::window(&args.board))
        .map_err(Fault::stage)?;
    let seen: BoardObservation<geometry::FlangeCamera> = BoardObservation::Pixels(found.corners);
    let posed = board_pose(camera, &seen).map_err(Fault::stage)?;
    Ok((posed.camera_from_board * board.centre()).mm.z)
}

/// Maximum number of random poses that see the board; the first one within the simulated arm's reach is used.
const MAX_DRAWS: usize = 20;

/// Returns the first pose of the simulated arm, in which the camera sees the board, as if a person had moved the arm.
fn first_pose(
    (args, cell, kind): (&HandEye, &CellFiles, BoardView),
    board: &Board,
    camera: PinholeCamera,
) -> Result<Option<Joints>, Fault> {
    let boards = session::board_cell((kind, board), (&args.live, Some(camera)))?;
    let flanges: Vec<Rigid<Base, Flange>> = match kind.is_fixed() {
        true => boards.fixed_shots(MAX_DRAWS).iter().map(|shot| shot.base_from_flange).collect(),
        false => boards.flange_shots(MAX_DRAWS).iter().map(|shot| shot.base_from_flange).collect(),
    };
    let arm = Kinematics::new(cell.cell.arm());
    let within =
        |flange: &Rigid<Base, Flange>| reach::postures(&arm, flange, Point::at(0.0, 0.0, 0.0)).into_iter().next();
    Ok(flanges.iter().find_map(within))
}
