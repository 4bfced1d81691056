//! The cameras of the simulated world. Each capture requests time and pose from the arm, then renders the world at this
//! time. The arm is a mock controller in this process, or one in another process whose messages are followed.
//!
//! Also the same cameras in front of calibration boards: held by a person, mounted on the flange, or fixed. If the arm
//! moves, it is the mock controller's arm. Without an arm, a simulated person moves the board or the camera to a new
//! pose for each picture. The true poses of the boards are not accessible outside of this module.
//!
//! With a colour sensor's filters, each pixel of the flange camera measures one colour, and the other two are
//! interpolated.

use super::{CameraError, CameraRole, FlangeCamera, FlangePicture, Picture, Scanner, Shot};
use crate::gige::{PixelFormat, demosaic, mosaic};
use crate::mock::{ContactSample, MockHandle};
use crate::world::{Follower, RobotMoment, SimulatedWorld};
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use panelprep_sim::{BoardCell, BoardShot, ScannerDistortion};

/// The pixel format of the simulated sensor, which defines its colour filters.
pub(super) const SENSOR_FORMAT: PixelFormat = PixelFormat::BayerRG8;

/// The robot arm in a simulated world.
#[derive(Clone)]
pub enum Arm {
    /// A mock controller in this process.
    Mock(MockHandle),
    /// A mock controller in another process, whose messages are followed; used in a rehearsal.
    Followed(Follower),
}

impl Arm {
    fn current_moment(&self, which: CameraRole) -> Result<RobotMoment, CameraError> {
        let reason = || "no state of the arm was received yet from the robot controller".to_owned();
        match self {
            Arm::Mock(robot) => Ok(robot.with_controller(|controller| RobotMoment::from_controller(controller))),
            Arm::Followed(robot) => {
                robot.current_moment().ok_or_else(|| CameraError::Missing { which, reason: reason() })
            }
        }
    }

    /// Returns the time and pose of the arm without taking a picture; `None` if no message was received from the
    /// controller yet.
    pub(crate) fn moment_now(&self) -> Option<RobotMoment> {
        self.current_moment(CameraRole::Flange).ok()
    }

    /// Returns the path of the tool in contact up to this time.
    fn trace(&self, until_ms: u64) -> Vec<ContactSample> {
        match self {
            Arm::Mock(robot) => robot.with_controller(|controller| {
                controller.trace().iter().filter(|sample| sample.time_ms <= until_ms).copied().collect()
            }),
            Arm::Followed(robot) => robot.trace(until_ms),
        }
    }
}

/// The fixed 3D camera in the simulated world.
#[derive(Clone)]
pub struct SimulatedScanner {
    world: SimulatedWorld,
    arm: Arm,
    clip: Option<Clip>,
}

/// A clip that is being recorded, in the time of the world.
#[derive(Debug, Clone, Copy)]
struct Clip {
    began_ms: u64,
    pictures_per_second: f64,
    taken: u32,
}

impl Clip {
    fn is_picture_due(&self, now_ms: u64) -> bool {
        now_ms.saturating_sub(self.began_ms) as f64 / 1e3 * self.pictures_per_second >= f64::from(self.taken)
    }
}

/// The camera on the flange of the mock robot.
#[derive(Clone)]
pub struct SimulatedFlangeCamera {
    world: SimulatedWorld,
    arm: Arm,
}

/// Creates both cameras of a world in which this arm moves.
pub fn simulated_cameras(world: &SimulatedWorld, arm: &Arm) -> (SimulatedScanner, SimulatedFlangeCamera) {
    let (scanner, flange) = (world.clone(), world.clone());
    (
        SimulatedScanner { world: scanner, arm: arm.clone(), clip: None },
        SimulatedFlangeCamera { world: flange, arm: arm.clone() },
    )
}

// Lock order: the arm is queried first, and its lock is released before the world is locked, because a mock controller
// calls the world while the controller is locked.

impl SimulatedScanner {
    fn picture(&self) -> Result<Picture, CameraError> {
        if let Some(until_ms) = self.world.abrasion_due_until() {
            self.world.abrade(&self.arm.trace(until_ms));
        }
        Ok(self.world.picture(&self.arm.current_moment(CameraRole::Scanner)?))
    }

    fn clip(&mut self) -> Result<&mut Clip, CameraError> {
        self.clip.as_mut().ok_or(CameraError::NoClip { which: CameraRole::Scanner })
    }
}

impl Scanner for SimulatedScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        self.clip = None;
        self.world.scan(&self.arm.current_moment(CameraRole::Scanner)?)
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        self.clip = None;
        self.picture()
    }

    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError> {
        let began_ms = self.arm.current_moment(CameraRole::Scanner)?.time_ms();
        self.clip = Some(Clip { began_ms, pictures_per_second, taken: 0 });
        Ok(began_ms as f64 / 1e3)
    }

    /// This function must not wait, because in lock step the time does not advance during a wait. It renders a picture
    /// if one is due.
    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError> {
        let now_ms = self.arm.current_moment(CameraRole::Scanner)?.time_ms();
        let clip = self.clip()?;
        if !clip.is_picture_due(now_ms) {
            return Ok(None);
        }
        clip.taken += 1;
        self.picture().map(Some)
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        self.clip()?;
        self.clip = None;
        Ok(0)
    }

    /// The check always succeeds, because the renderer is part of this program.
    fn check_ready(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}

impl FlangeCamera for SimulatedFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        self.world.flange_picture(&self.arm.current_moment(CameraRole::Flange)?)
    }

    /// The check always succeeds, because the renderer is part of this program.
    fn check_ready(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}

/// The camera that views a board, and how the board is mounted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoardView {
    /// The fixed camera views a board that a person holds.
    HandHeldForFixed,
    /// The flange camera views a board that a person holds.
    HandHeldForFlange,
    /// The fixed camera views a board on the flange.
    Fixed,
    /// The flange camera views a fixed board.
    Flange,
}

impl BoardView {
    /// Returns whether the fixed camera views the board.
    pub fn is_fixed(self) -> bool {
        matches!(self, BoardView::Fixed | BoardView::HandHeldForFixed)
    }
}

/// A simulated camera that views a calibration board.
pub struct SimulatedBoards {
    cell: BoardCell,
    view: BoardView,
    arm: Option<MockHandle>,
    taken: usize,
}

impl SimulatedBoards {
    /// Creates a camera of this cell. If there is an arm, the view depends on the arm's pose.
    pub fn new(cell: BoardCell, view: BoardView, arm: Option<MockHandle>) -> Self {
        SimulatedBoards { cell, view, arm, taken: 0 }
    }

    /// Returns the next picture. If the board or the camera is on the flange, also returns the flange pose that the
    /// controller reports.
    ///
    /// # Errors
    /// If the arm moves.
    pub fn capture(&mut self) -> Result<(ColorPicture, Option<Rigid<Base, Flange>>), CameraError> {
        let (number, stood) = self.next()?;
        let (scanner, flange_camera) = (self.cell.scanner(), self.cell.flange_camera());
        let (picture, flange) = match self.view {
            BoardView::HandHeldForFixed => {
                let shots = self.cell.lens_shots::<panelprep_base::geometry::Camera>(&scanner, number + 1);
                (self.cell.picture(&scanner, &shots[number]), None)
            }
            BoardView::HandHeldForFlange => {
                let shots =
                    self.cell.lens_shots::<panelprep_base::geometry::FlangeCamera>(&flange_camera, number + 1);
                (self.cell.picture(&flange_camera, &shots[number]), None)
            }
            BoardView::Fixed => {
                let shot = self.view_of_flange_board(number, stood);
                (self.cell.picture(&scanner, &shot), Some(shot.base_from_flange))
            }
            BoardView::Flange => {
                let shot = match stood {
                    Some(flange) => self.cell.flange_view(number as u64, flange),
                    None => self.cell.flange_shots(number + 1)[number],
                };
                (self.cell.picture(&flange_camera, &shot), Some(shot.base_from_flange))
            }
        };
        Ok((picture.to_color(), flange))
    }

    /// Returns the next 3D scan of the fixed camera with the board on the flange, and the flange pose that the
    /// controller reports.
    ///
    /// # Errors
    /// If the arm moves.
    pub fn scan(&mut self) -> Result<(OrganizedCloud<Camera>, Rigid<Base, Flange>), CameraError> {
        let (number, stood) = self.next()?;
        let shot = self.view_of_flange_board(number, stood);
        let exact = ScannerDistortion::new(0, 0.0);
        Ok((self.cell.real_scan(&shot, &exact), shot.base_from_flange))
    }

    /// Returns the number of the next capture, and the pose of the flange if there is an arm.
    fn next(&mut self) -> Result<(usize, Option<Rigid<Base, Flange>>), CameraError> {
        let number = self.taken;
        self.taken += 1;
        match self.arm.as_ref().map(|arm| arm.with_controller(|arm| (arm.is_moving(), arm.flange_pose()))) {
            Some((true, _)) => Err(CameraError::ArmMoves),
            stood => Ok((number, stood.map(|(_, flange)| flange))),
        }
    }

    /// Renders the view of the fixed camera on the board that is mounted on the flange.
    fn view_of_flange_board(&self, number: usize, stood: Option<Rigid<Base, Flange>>) -> BoardShot<Camera> {
        match stood {
            Some(flange) => self.cell.fixed_view(number as u64, flange),
            None => self.cell.fixed_shots(number + 1)[number],
        }
    }
}

/// The simulated flange camera with the colour filters of a sensor, without a network between camera and program.
pub struct BayerFlangeCamera {
    simulated: SimulatedFlangeCamera,
}

impl BayerFlangeCamera {
    /// Adds the colour filters to a simulated camera.
    pub fn new(simulated: SimulatedFlangeCamera) -> Self {
        BayerFlangeCamera { simulated }
    }
}

impl FlangeCamera for BayerFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let seen = self.simulated.capture()?;
        let size_px = [seen.picture.width, seen.picture.height];
        let colored = demosaic(&mosaic(&seen.picture, SENSOR_FORMAT), size_px, SENSOR_FORMAT);
        Ok(FlangePicture { picture: colored.unwrap_or_else(|| seen.picture.clone()), ..seen })
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.simulated.check_ready()
    }
}
