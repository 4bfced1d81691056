//! The simulated world's cameras: each capture queries the arm for its time and pose, then renders the world at that
//! time. The arm is a mock controller in this process, or a mock controller in another process whose messages are
//! followed.

use super::{CameraError, CameraRole, FlangeCamera, FlangePicture, Picture, Scanner, Shot};
use crate::mock::{ContactSample, MockHandle};
use crate::world::{Follower, RobotMoment, SimulatedWorld};

/// The arm that moves in a simulated world.
#[derive(Clone)]
pub enum Arm {
    /// A mock controller in this process.
    Mock(MockHandle),
    /// A mock controller in another process, in a rehearsal.
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

    /// Returns the time and pose of the arm for callers that take no picture; `None` if nothing was received from the
    /// controller yet.
    pub(crate) fn moment_now(&self) -> Option<RobotMoment> {
        self.current_moment(CameraRole::Flange).ok()
    }

    /// Returns the path of the tool up to this time.
    fn trace(&self, until_ms: u64) -> Vec<ContactSample> {
        match self {
            Arm::Mock(robot) => robot.with_controller(|controller| {
                controller.trace().iter().filter(|sample| sample.time_ms <= until_ms).copied().collect()
            }),
            Arm::Followed(robot) => robot.trace(until_ms),
        }
    }
}

/// The scanner that looks at the simulated world.
#[derive(Clone)]
pub struct SimulatedScanner {
    world: SimulatedWorld,
    arm: Arm,
    clip: Option<Clip>,
}

/// A clip that is being taken, in the world's time.
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

/// The camera on the mock robot's flange.
#[derive(Clone)]
pub struct SimulatedFlangeCamera {
    world: SimulatedWorld,
    arm: Arm,
}

/// Returns both cameras of a world and of the arm that moves in it.
pub fn simulated_cameras(world: &SimulatedWorld, arm: &Arm) -> (SimulatedScanner, SimulatedFlangeCamera) {
    let (scanner, flange) = (world.clone(), world.clone());
    (
        SimulatedScanner { world: scanner, arm: arm.clone(), clip: None },
        SimulatedFlangeCamera { world: flange, arm: arm.clone() },
    )
}

// The arm is queried first, and its lock is released before the world is used: a mock controller calls the world while
// it is locked.

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

    /// Never waits, since in lock step time stops during a wait: the picture is taken when it is due.
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

    /// Always succeeds: the renderer is part of this program.
    fn check_ready(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}

impl FlangeCamera for SimulatedFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        self.world.flange_picture(&self.arm.current_moment(CameraRole::Flange)?)
    }

    /// Always succeeds: the renderer is part of this program.
    fn check_ready(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}
