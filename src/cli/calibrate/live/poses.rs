//! Where the flange was at a picture: as the camera's source says, as the service says, or as a person reads it from the pendant.

use super::super::super::ctl;
use super::super::super::fault::Fault;
use super::super::super::load::CellFiles;
use super::super::super::robot;
use super::session::{Pose, answer, tell};
use crate::geometry::{Base, Flange, Joints, Rigid};
use crate::path::Kinematics;
use std::path::PathBuf;

/// The axes must stand within this from before a picture until after it, degrees.
const STANDS_DEG: f64 = 0.002;

/// Who says where the flange is.
pub struct Poses {
    arm: Kinematics,
    socket: PathBuf,
}

impl Poses {
    /// Of this cell.
    pub fn of(cell: &CellFiles) -> Self {
        Poses { arm: Kinematics::new(cell.cell.arm()), socket: cell.socket() }
    }

    /// Where the axes stand now, as a service that runs says.
    ///
    /// # Errors
    /// None today; a service that does not answer says nothing.
    pub fn now(&self) -> Result<Option<Joints>, Fault> {
        Ok(ctl::axes_of(&self.socket))
    }

    /// Where the flange was at a picture that was taken just now; none where nobody knows, and the picture does not count.
    ///
    /// # Errors
    /// Where nobody can be asked.
    pub fn of_picture(
        &mut self,
        before: Option<Joints>,
        from_camera: Option<Rigid<Base, Flange>>,
    ) -> Result<Option<Pose>, Fault> {
        if let (Some(before), Some(after)) = (before, self.now()?) {
            if before.degrees().iter().zip(after.degrees()).any(|(a, b)| (a - b).abs() > STANDS_DEG) {
                tell("the arm moved while the picture was taken: it does not count; wait until the arm stands");
                return Ok(None);
            }
            if let Some(base_from_flange) = self.arm.drawn_flange(&after) {
                return Ok(Some(Pose { base_from_flange, joints: Some(after) }));
            }
        }
        if let Some(base_from_flange) = from_camera {
            return Ok(Some(Pose { base_from_flange, joints: None }));
        }
        loop {
            tell(
                "Where is the flange? Write X,Y,Z,A,B,C as the pendant shows them with $NULLFRAME as tool and base.",
            );
            let Some(line) = answer()? else { return Ok(None) };
            match robot::pose_of(&line) {
                Ok(pose) => return Ok(Some(Pose { base_from_flange: pose.to_rigid(), joints: None })),
                Err(problem) => tell(&problem),
            }
        }
    }
}
