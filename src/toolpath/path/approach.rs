//! Computes the arm's motion before contact: from its park pose through the views of the taught corners. Its end is the
//! start of the contact path.
//!
//! Before contact the arm is at the last corner that the stage Verify views. The arm moves from the park pose through
//! the ready pose, unless the park pose lies inside of the box, and then by lines from corner to corner. Linear motions
//! do not change the arm's configuration. The same checks with the same obstacles apply to these planned motions. Each
//! actual motion is checked again from the actual axis angles: see `routes`.

use super::Kinematics;
use super::panel_reach::ReachSetup;
use super::reach::{Obstacles, joint_motion};
use super::routes::{self, Sander, StartState};
use panelprep_base::geometry::{Base, Flange, FlangeCamera, Joints, Panel, Rigid, Tool};
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{self, Limits};
use panelprep_cell::panel::TaughtCorner;
use std::sync::Arc;

/// The arm with its start pose, its camera and its sander, for the motion to the taught corners.
#[derive(Debug, Clone, Copy)]
pub struct CornerTour<'a> {
    /// The limits of the cell's file.
    pub limits: &'a Limits,
    /// The arm of the cell's file.
    pub arm: &'a cell::Arm,
    /// Axis angles of the park pose.
    pub park: Joints,
    /// `[poses.ready]`: an intermediate pose on the way to and from the park pose, if the cell's file has one.
    pub ready: Option<Joints>,
    /// Mount of the flange camera.
    pub flange_from_camera: Rigid<Flange, FlangeCamera>,
    /// The sander, which must keep its distances from the obstacles during the camera's motion.
    pub sander: Sander,
    /// The corners that were taught, with their views.
    pub corners: &'a [TaughtCorner],
}

/// The panel's pose, the corners that are viewed before contact, and the obstacles on the way to these corners.
#[derive(Debug, Clone, Copy)]
pub struct Approach<'a> {
    /// The panel's present pose.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Numbers of the taught corners, from 0, in the order in which they are viewed.
    pub corners: &'a [usize],
    /// The panel and all other objects that a scan showed; `None` without a scan.
    pub obstacles: Option<&'a Arc<Obstacles>>,
}

impl<'a> CornerTour<'a> {
    /// Returns the set-up for the reach check: the panel, the sanding tool, and the arm at the axis angles that it has
    /// after the view of the last corner.
    ///
    /// # Errors
    /// If there is no corner, or if the arm cannot reach one of the corners.
    pub fn reach_setup<'k>(
        &self,
        kinematics: &'k Kinematics,
        panel: &Approach<'_>,
    ) -> Result<ReachSetup<'k>, Reason> {
        let mut at = self.line_start_joints(kinematics, panel.obstacles)?;
        for &corner in panel.corners {
            at = self.joints_at_corner(kinematics, (at, corner), panel)?;
        }
        if panel.corners.is_empty() {
            return Err(no_corner_reason());
        }
        let (flange_from_tool, base_from_panel) = (self.sander.flange_from_tip, panel.base_from_panel);
        Ok(ReachSetup { arm: kinematics, flange_from_tool, base_from_panel, start_joints: Some(at) })
    }

    /// Returns the first corners that the arm can reach, at most this number of them. Only the obstacles of the cell's
    /// file are taken into account.
    ///
    /// # Errors
    /// If no corner was taught, or if the arm can reach none of the corners.
    pub fn reachable_corners(
        &self,
        kinematics: &Kinematics,
        base_from_panel: Rigid<Base, Panel>,
        most: usize,
    ) -> Result<Vec<usize>, Reason> {
        let panel = Approach { base_from_panel, corners: &[], obstacles: None };
        let (mut at, mut chosen, mut why) = (self.line_start_joints(kinematics, None)?, Vec::new(), None);
        for corner in 0..self.corners.len() {
            match self.joints_at_corner(kinematics, (at, corner), &panel) {
                Ok(joints) => {
                    at = joints;
                    chosen.push(corner);
                }
                Err(reason) => why = why.or(Some(reason)),
            }
            if chosen.len() >= most {
                break;
            }
        }
        if chosen.is_empty() { Err(why.unwrap_or_else(no_corner_reason)) } else { Ok(chosen) }
    }

    /// Returns the pose of the camera on the flange, as the arm's tool for this motion.
    fn camera(&self) -> Rigid<Flange, Tool> {
        Rigid::from_isometry_unchecked(*self.flange_from_camera.isometry())
    }

    /// Returns the axis angles at the start of the first linear motion.
    fn line_start_joints(
        &self,
        kinematics: &Kinematics,
        obstacles: Option<&Arc<Obstacles>>,
    ) -> Result<Joints, Reason> {
        let park_is_inside = self.limits.workspace().is_some_and(|workspace| {
            let flange = kinematics.base_from_flange(&self.park);
            flange.is_some_and(|flange| workspace.contains((flange * self.camera()).origin()))
        });
        let Some(ready) = self.ready.filter(|_| !park_is_inside) else { return Ok(self.park) };
        let beside = match obstacles {
            Some(obstacles) => kinematics.clone().with_obstacles(obstacles.clone()),
            None => kinematics.clone(),
        };
        let met = |obstacle| {
            Reason::new("out_of_reach", format!("on the motion from the park pose to the ready pose: {obstacle}"))
        };
        for tip in self.sander.tips().into_iter().chain([self.camera()]) {
            joint_motion(&beside, tip, &self.park, &ready).map_err(met)?;
        }
        Ok(ready)
    }

    /// Returns the axis angles at a corner, after a linear motion from the axis angles `at`.
    fn joints_at_corner(
        &self,
        kinematics: &Kinematics,
        (at, corner): (Joints, usize),
        panel: &Approach<'_>,
    ) -> Result<Joints, Reason> {
        let taught = self.corners.get(corner).ok_or_else(no_corner_reason)?;
        let flange_from_tool = self.camera();
        let not_finite = || {
            Reason::new(
                "out_of_reach",
                "the axis angles of the park or ready pose are not valid numbers; \
                correct [poses] in the cell's file",
            )
        };
        let from = kinematics.base_from_flange(&at).ok_or_else(not_finite)? * flange_from_tool;
        let to = Rigid::from_isometry_unchecked(
            *(panel.base_from_panel * taught.teaching_data.panel_from_camera).isometry(),
        );
        let (limits, arm, obstacles) = (self.limits, self.arm, panel.obstacles);
        let standing = StartState { limits, arm, flange_from_tool, joints: at, obstacles };
        let gated = routes::gate_view(&standing, (from, to), self.sander);
        let refused = gated.judgement().reasons.into_iter().next();
        let on_the_way = |reason: Reason| Reason {
            message: format!("on the motion to corner {}: {}", corner + 1, reason.message),
            ..reason
        };
        gated.joints.ok_or_else(|| refused.map_or_else(not_finite, on_the_way))
    }
}

fn no_corner_reason() -> Reason {
    Reason::new("no_corner", "no corner was taught")
}
