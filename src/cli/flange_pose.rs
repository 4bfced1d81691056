//! The flange pose of a picture that is captured now. It is reported by the service or, if no service runs, by the
//! controller, or by the source of the picture; otherwise a person reads it from the pendant.

use super::fault::Fault;
use super::output::{read_answer_line, write_progress};
use super::{live, robot};
use panelprep_base::geometry::{Base, Flange, Joints, KukaPose, Rigid};
use panelprep_cell::cell::{self, RobotKind};
use panelprep_cell::files::ReportedFlange;
use panelprep_kuka::eki::Report;
use panelprep_service::daemon::{LinkedRobot, RobotPort, service_axes, service_state};
use panelprep_service::setup::CellFiles;
use panelprep_toolpath::path::Kinematics;
use std::cell::{Cell as Counter, RefCell};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Maximum difference of an axis angle between before and after a picture at which the arm is treated as at rest,
/// degrees.
const STANDSTILL_TOLERANCE_DEG: f64 = 0.002;
/// Time limit for a report of the controller.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(5);
const MAX_MISSED_ANSWERS: u32 = 2;

/// What is known about the flange pose of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PoseKnowledge {
    /// The flange was at this reported pose.
    At(ReportedFlange),
    /// The arm moved while the picture was captured.
    Moved,
    /// No pose was reported.
    Nothing,
}

/// The sources that can report the flange pose of a picture.
pub struct FlangePoses<'c> {
    cell: &'c cell::Cell,
    arm: Kinematics,
    socket: PathBuf,
    /// The link to the controller, open from before a picture until after it; only if no service runs.
    link: RefCell<Option<LinkedRobot>>,
    /// Number of reports that did not arrive in time; after [`MAX_MISSED_ANSWERS`] of them the controller is not
    /// queried again.
    missed_answers: Counter<u32>,
}

impl<'c> FlangePoses<'c> {
    /// Creates the sources of the flange pose for this cell.
    pub fn new(files: &'c CellFiles) -> Self {
        FlangePoses {
            cell: &files.cell,
            arm: Kinematics::new(files.cell.arm()),
            socket: files.socket(),
            link: RefCell::new(None),
            missed_answers: Counter::new(0),
        }
    }

    /// Returns the current axis angles, before a picture is captured. They come from the running service if it knows
    /// them or, if no service runs, from the controller if it responds.
    pub fn now(&self) -> Option<Joints> {
        match service_state(&self.socket) {
            Some(_) => service_axes(&self.socket),
            None => self.ask_controller(),
        }
    }

    /// Reads the axis angles from the controller, like `panelprep robot state`: nothing is set and nothing moves.
    fn ask_controller(&self) -> Option<Joints> {
        if self.cell.robot().kind() != RobotKind::Eki || self.missed_answers.get() >= MAX_MISSED_ANSWERS {
            return None;
        }
        let mut kept = self.link.borrow_mut();
        let mut link = match kept.take() {
            Some(link) => link,
            None => live::robot_alone(self.cell).ok()?.0,
        };
        let report = next_controller_report(&mut link);
        match report {
            Some(_) => *kept = Some(link),
            None => self.missed_answers.set(self.missed_answers.get() + 1),
        }
        report
    }

    /// Returns the axis angles after the picture, and closes the link to the controller, so that other clients can use
    /// it.
    fn axes_after_picture(&self) -> Option<Joints> {
        let report = self.now();
        self.link.borrow_mut().take();
        report
    }

    /// Combines the axis angles before and after the picture with the pose that the source of the picture reports.
    pub fn combine_reports(
        &self,
        before: Option<Joints>,
        from_camera: Option<Rigid<Base, Flange>>,
    ) -> PoseKnowledge {
        combine_evidence(&self.arm, before.zip(before.and_then(|_| self.axes_after_picture())), from_camera)
    }

    /// Returns the pose from [`FlangePoses::combine_reports`], or asks a person if no pose was reported. `None` if the
    /// arm moved during the picture, or the person does not answer.
    ///
    /// # Errors
    /// If standard input cannot be read.
    pub fn combine_or_ask(
        &self,
        before: Option<Joints>,
        from_camera: Option<Rigid<Base, Flange>>,
    ) -> Result<Option<ReportedFlange>, Fault> {
        match self.combine_reports(before, from_camera) {
            PoseKnowledge::At(flange) => return Ok(Some(flange)),
            PoseKnowledge::Moved => {
                write_progress(
                    "the arm moved during the measurement, which is discarded; wait until the arm has stopped, then repeat the measurement",
                );
                return Ok(None);
            }
            PoseKnowledge::Nothing => {}
        }
        loop {
            write_progress(
                "Enter the flange's pose as X,Y,Z,A,B,C, as the pendant shows it with $NULLFRAME as tool and base.",
            );
            let Some(line) = read_answer_line()? else { return Ok(None) };
            match robot::parse_pose_argument(&line) {
                Ok(base_from_flange) => return Ok(Some(ReportedFlange { base_from_flange, joints: None })),
                Err(problem) => write_progress(&problem),
            }
        }
    }
}

/// Returns the next report of the controller; reports that are already in the queue are older and are skipped.
fn next_controller_report(link: &mut LinkedRobot) -> Option<Joints> {
    let (begun, mut is_drained) = (Instant::now(), false);
    while begun.elapsed() < RESPONSE_TIMEOUT {
        match link.next().ok()? {
            None => is_drained = true,
            Some(Report::Connected { state } | Report::State(state)) if is_drained => return Some(state.joints),
            Some(_) => {}
        }
    }
    None
}

fn combine_evidence(
    arm: &Kinematics,
    axes: Option<(Joints, Joints)>,
    from_camera: Option<Rigid<Base, Flange>>,
) -> PoseKnowledge {
    if let Some((before, after)) = axes {
        if before.max_difference_deg(&after) > STANDSTILL_TOLERANCE_DEG {
            return PoseKnowledge::Moved;
        }
        if let Some(flange) = controller_pose(arm, &after) {
            return PoseKnowledge::At(flange);
        }
    }
    let at = |flange: Rigid<Base, Flange>| {
        PoseKnowledge::At(ReportedFlange { base_from_flange: KukaPose::from_rigid(&flange), joints: None })
    };
    from_camera.map_or(PoseKnowledge::Nothing, at)
}

/// Returns the flange pose that the controller calculates from these axis angles; `None` if they are not finite
/// numbers.
pub fn controller_pose(arm: &Kinematics, joints: &Joints) -> Option<ReportedFlange> {
    let base_from_flange = KukaPose::from_rigid(&arm.nominal_flange(joints)?);
    Some(ReportedFlange { base_from_flange, joints: Some(*joints) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use panelprep_cell::cell::Cell;

    /// At A2 = −90° and A3 = 90° the flange is 25 + 365 + 90 mm in front of the base, and 400 + 335 + 25 mm above it.
    #[test]
    fn a_flange_is_known_only_while_the_arm_is_at_rest() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|error| panic!("{error}"));
        let arm = Kinematics::new(cell.arm());
        let axes = [0.0, -90.0, 90.0, 0.0, 0.0, 0.0];
        let joints = Joints::from(axes);
        let PoseKnowledge::At(flange) = combine_evidence(&arm, Some((joints, joints)), None) else {
            panic!("known")
        };
        let at = flange.base_from_flange;
        assert!((at.x_mm - 480.0).abs() < 1e-6 && at.y_mm.abs() < 1e-6 && (at.z_mm - 760.0).abs() < 1e-6, "{at:?}");
        assert_eq!(flange.joints, Some(joints));
        let moved = Joints::from([0.0, -90.0, 90.003, 0.0, 0.0, 0.0]);
        let seen: Rigid<Base, Flange> = Rigid::from_isometry_unchecked(Isometry3::translation(1.0, 2.0, 3.0));
        assert_eq!(combine_evidence(&arm, Some((joints, moved)), Some(seen)), PoseKnowledge::Moved);
        assert_eq!(combine_evidence(&arm, None, None), PoseKnowledge::Nothing);
        let PoseKnowledge::At(flange) = combine_evidence(&arm, None, Some(seen)) else {
            panic!("the camera knows it")
        };
        assert_eq!((flange.base_from_flange.z_mm, flange.joints), (3.0, None));
    }
}
