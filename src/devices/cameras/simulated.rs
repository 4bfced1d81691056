//! The simulated world's cameras: each capture asks the mock controller when it is and where the arm stands, then
//! has the world rendered as it is at that time.

use super::{CameraError, FlangeCamera, FlangePicture, Picture, Scanner, Shot};
use crate::devices::mock::MockHandle;
use crate::devices::world::{Moment, SimulatedWorld};

/// The scanner that looks at the simulated world.
#[derive(Clone)]
pub struct SimulatedScanner {
    world: SimulatedWorld,
    robot: MockHandle,
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
        SimulatedScanner { world: scanner, robot: robot.clone() },
        SimulatedFlangeCamera { world: flange, robot: robot.clone() },
    )
}

// The controller is asked first and let go: it calls the world while it is held.

impl Scanner for SimulatedScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        let now = self.robot.with(|controller| Moment::of(controller));
        self.world.scan(&now)
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        if let Some(until_ms) = self.world.abrasion_is_due() {
            let so_far = |controller: &mut crate::devices::mock::Controller| {
                controller.trace().iter().filter(|sample| sample.time_ms <= until_ms).copied().collect::<Vec<_>>()
            };
            let trace = self.robot.with(so_far);
            self.world.abrade(&trace);
        }
        let now = self.robot.with(|controller| Moment::of(controller));
        Ok(self.world.picture(&now))
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
