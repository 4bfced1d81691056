//! The simulated world's cameras: each capture asks the mock controller when it is and where the arm stands, then
//! has the world rendered as it is at that time.

use super::{CameraError, FlangeCamera, FlangePicture, Picture, Scanner, Shot, Which};
use crate::devices::mock::MockHandle;
use crate::devices::world::{Moment, SimulatedWorld};

/// The scanner that looks at the simulated world.
#[derive(Clone)]
pub struct SimulatedScanner {
    world: SimulatedWorld,
    robot: MockHandle,
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
    fn is_due(&self, now_ms: u64) -> bool {
        now_ms.saturating_sub(self.began_ms) as f64 / 1e3 * self.pictures_per_second >= f64::from(self.taken)
    }
}

/// The camera on the mock robot's flange.
#[derive(Clone)]
pub struct SimulatedFlangeCamera {
    world: SimulatedWorld,
    robot: MockHandle,
}

/// Both cameras of a world and the mock controller that moves in it.
pub fn simulated(world: &SimulatedWorld, robot: &MockHandle) -> (SimulatedScanner, SimulatedFlangeCamera) {
    let (scanner, flange) = (world.clone(), world.clone());
    (
        SimulatedScanner { world: scanner, robot: robot.clone(), clip: None },
        SimulatedFlangeCamera { world: flange, robot: robot.clone() },
    )
}

// The controller is asked first and let go: it calls the world while it is held.

impl SimulatedScanner {
    fn picture(&self) -> Picture {
        if let Some(until_ms) = self.world.abrasion_is_due() {
            let so_far = |controller: &mut crate::devices::mock::Controller| {
                controller.trace().iter().filter(|sample| sample.time_ms <= until_ms).copied().collect::<Vec<_>>()
            };
            let trace = self.robot.with(so_far);
            self.world.abrade(&trace);
        }
        let now = self.robot.with(|controller| Moment::of(controller));
        self.world.picture(&now)
    }

    fn clip(&mut self) -> Result<&mut Clip, CameraError> {
        self.clip.as_mut().ok_or(CameraError::NoClip { which: Which::Scanner })
    }
}

impl Scanner for SimulatedScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        self.clip = None;
        let now = self.robot.with(|controller| Moment::of(controller));
        self.world.scan(&now)
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        self.clip = None;
        Ok(self.picture())
    }

    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError> {
        let began_ms = self.robot.with(|controller| controller.time_ms());
        self.clip = Some(Clip { began_ms, pictures_per_second, taken: 0 });
        Ok(began_ms as f64 / 1e3)
    }

    /// Time stands while somebody waits for a picture, so nobody does: it is taken when it is due.
    fn next_of_clip(&mut self) -> Result<Option<Picture>, CameraError> {
        let now_ms = self.robot.with(|controller| controller.time_ms());
        let clip = self.clip()?;
        if !clip.is_due(now_ms) {
            return Ok(None);
        }
        clip.taken += 1;
        Ok(Some(self.picture()))
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        self.clip()?;
        self.clip = None;
        Ok(0)
    }

    /// The renderer is part of this program.
    fn check(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}

impl FlangeCamera for SimulatedFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let now = self.robot.with(|controller| Moment::of(controller));
        self.world.flange_picture(&now)
    }

    /// The renderer is part of this program.
    fn check(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}
