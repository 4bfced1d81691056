//! The true pose of the arm, independent of the reports: a person may jog the arm, its measured pose may be wrong, and
//! its override may be another one.

use super::super::fixture::{CellContents, Fixture};
use super::super::sabotage::Sabotage;
use super::super::script::{self, Fault};
use super::{Inside, MAX_CONTACT_HEIGHT_MM, START};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use panelprep::devices::mock::{self, Mode};
use panelprep::eki::{CommandId, Epoch};
use panelprep::geometry::{Base, Flange, Joints, Panel, Point, Rigid, Tool};
use panelprep::stages::abrade::deviation_limit_mm;
use std::collections::VecDeque;

/// Minimum distance of the tip from the panel during an axis motion, mm.
const MIN_AXIS_MOTION_DISTANCE_MM: f64 = 5.0;
/// Delay of a state in transit, and of the controller's programs, ms.
const MAX_OVERRIDE_DELAY_MS: u64 = 300 + 250;
const MEASURED_MS: u64 = 600;
/// Ratio of the deviation at which a contact path ends immediately to the deviation that requires a review.
const MAX_DEVIATION_FACTOR: f64 = 4.0;
/// The middle of the panel in its own frame, mm.
const PANEL_MIDDLE_MM: [f64; 3] = [560.0, 0.0, 360.0];
/// Number of stored axis motions.
const STORED_AXIS_MOTION_COUNT: usize = 8;

/// A jog that waits until the arm is stationary.
#[derive(Debug, Clone, Copy)]
pub struct Jog {
    pub percent: u8,
    pub height_mm: u8,
    pub for_ms: u64,
}

/// Positions of the arm, and facts about these positions.
#[derive(Debug, Default)]
pub struct Places {
    pub jog: Option<Jog>,
    /// The axis angles before a person jogged the arm, and the axis angles to which the person jogged it.
    jogged: Option<(Joints, Joints)>,
    /// The axis motions of the client.
    by_axes: VecDeque<(Epoch, CommandId)>,
    joints: Option<Joints>,
    /// Time until which the controller does not report its override, because of an injected error, ms.
    hidden_override_until_ms: u64,
    overridden_since_ms: Option<u64>,
    measured_since_ms: Option<u64>,
}

impl Places {
    /// Records that the client accepts an axis motion to send.
    pub fn by_axes(&mut self, epoch: Epoch, id: CommandId) {
        self.by_axes.push_back((epoch, id));
        if self.by_axes.len() > STORED_AXIS_MOTION_COUNT {
            self.by_axes.pop_front();
        }
    }

    /// Returns the axis angles of the arm before a person jogged it to its present ones.
    pub fn joints_before_jog(&self, now: &Joints) -> Option<Joints> {
        self.jogged.filter(|(_, to)| to == now).map(|(from, _)| from)
    }
}

impl Inside {
    /// Returns the controller's fault with this name, except for the part that an injected error changes.
    pub(super) fn fault_of(&mut self, text: &str) -> Option<mock::Fault> {
        let fault = script::controller_fault(text).ok()?;
        let now_ms = self.now_ms();
        let slows = match fault {
            mock::Fault::Slow { for_ms, percent } | mock::Fault::Override { for_ms, percent } => {
                Some((for_ms?, percent))
            }
            _ => None,
        };
        if let Some((for_ms, percent)) = slows {
            (self.oracles.slowed_until_ms, self.oracles.slowed_to_percent) = (now_ms + for_ms, percent);
        }
        match (fault, self.sabotage) {
            (mock::Fault::Override { percent, for_ms }, Some(Sabotage::HidesOverride)) if percent < 100 => {
                self.places.hidden_override_until_ms = now_ms + for_ms.unwrap_or_default();
                Some(mock::Fault::Slow { percent, for_ms })
            }
            _ => Some(fault),
        }
    }

    /// Jogs the arm in T1, as a person does after the arm is stationary.
    pub(super) fn jogs(&mut self) {
        let Some(jog) = self.places.jog else { return };
        let (from, to) = (self.cell.controller.joints(), self.jogged_to(jog));
        let (true, Some(to)) = (!self.cell.controller.is_moving(), to) else {
            return;
        };
        self.places.jog = None;
        let mode = mock::Fault::Mode { to: Mode::T1, for_ms: Some(jog.for_ms) };
        self.expects_of(&mode);
        self.cell.controller.apply_fault(mode);
        let until_ms = self.now_ms() + Fault::Jog { percent: 0, height_mm: 0, for_ms: jog.for_ms }.lasts_ms();
        self.lasts_until_ms = self.lasts_until_ms.max(until_ms);
        self.others_last_until_ms = self.others_last_until_ms.max(until_ms);
        self.struck_ms = self.now_ms();
        if self.cell.controller.jog_to(to) {
            self.oracles.jogged(self.cell.controller.joints());
            self.places.jogged = Some((from, self.cell.controller.joints()));
            self.places.joints = None;
            self.counts.jogs += 1;
        }
    }

    /// Returns the axis positions to which a person jogs the arm; `None` if the tool would be in the panel.
    fn jogged_to(&self, jog: Jog) -> Option<Joints> {
        let (near, park) = (near_panel(f64::from(jog.height_mm))?, Fixture::shared().setup.park_pose);
        let share = f64::from(jog.percent.min(100)) / 100.0;
        let axis = |index: usize| near.degrees()[index] + (park.degrees()[index] - near.degrees()[index]) * share;
        let to = Joints::from(std::array::from_fn(axis));
        let flange = mock::Arm::kr6_r700_2().base_from_flange(&to);
        let (height_mm, beside_mm) = above_panel(&flange);
        (height_mm > 0.5 || beside_mm > 0.0).then_some(to)
    }

    /// Checks the requirements that apply wherever the arm is.
    pub(super) fn judge_where(&mut self) {
        let joints = self.cell.controller.joints();
        let before = self.places.joints.replace(joints);
        let moved = before.is_some_and(|before| before.max_difference_deg(&joints) > 1e-3);
        self.judge_axis_motion(moved);
        self.judge_override(moved);
        self.judge_measured(moved);
    }

    /// Checks that no motion begins at an unknown pose: in an axis motion the tip is never near the panel, however the
    /// arm came to its start.
    fn judge_axis_motion(&mut self, moved: bool) {
        let controller = &self.cell.controller;
        let under_way = CommandId(controller.counts().1.cast_unsigned() + 1);
        let epoch = Epoch(controller.epoch().cast_unsigned());
        let is_by_axes = self.places.by_axes.contains(&(epoch, under_way));
        let moves = moved && is_by_axes && !controller.is_stopped();
        if !moves || self.is_strange() || self.places_lie || self.stands == CellContents::Nothing {
            return;
        }
        self.counts.judged("no motion from an unknown place");
        let (height_mm, beside_mm) = above_panel(&self.cell.controller.flange_pose());
        if height_mm < MIN_AXIS_MOTION_DISTANCE_MM && beside_mm < MIN_AXIS_MOTION_DISTANCE_MM {
            let what = format!(
                "{under_way} of epoch {epoch:?} moves the axes, and the tip is {height_mm:.1} mm off the panel"
            );
            self.wrong("no motion from an unknown place", what);
        }
    }

    /// Checks that there is no contact at another override than 100 %.
    fn judge_override(&mut self, moved: bool) {
        let is_other =
            self.cell.controller.override_percent() != 100 || self.now_ms() < self.places.hidden_override_until_ms;
        if !(is_other && self.is_in_contact(moved)) {
            // Nothing moves between two ticks, so a tick without motion does not reset the time.
            if !is_other || self.cell.controller.is_stopped() || self.height_mm() >= MAX_CONTACT_HEIGHT_MM {
                self.places.overridden_since_ms = None;
            }
            return;
        }
        self.counts.judged("no contact at another override");
        let now_ms = self.now_ms();
        let since_ms = *self.places.overridden_since_ms.get_or_insert(now_ms);
        if now_ms > since_ms + MAX_OVERRIDE_DELAY_MS {
            let percent = self.cell.controller.override_percent();
            let what =
                format!("the override is another one ({percent} %), and contact has continued for {since_ms} ms");
            self.wrong("no contact at another override", what);
        }
    }

    /// Checks that contact ends if the measured pose is far from the path.
    fn judge_measured(&mut self, moved: bool) {
        let far_mm = MAX_DEVIATION_FACTOR * deviation_limit_mm(Fixture::shared().cycle.recipe.path());
        let is_far = self.cell.controller.pose_deviation_mm() > far_mm + MAX_CONTACT_HEIGHT_MM
            && self.is_calm_but_for_feedback();
        if !(is_far && self.is_in_contact(moved)) {
            if !is_far || self.cell.controller.is_stopped() || self.height_mm() >= MAX_CONTACT_HEIGHT_MM {
                self.places.measured_since_ms = None;
            }
            return;
        }
        self.counts.judged("no contact at a pose far off");
        let now_ms = self.now_ms();
        let since_ms = *self.places.measured_since_ms.get_or_insert(now_ms);
        if now_ms > since_ms + MEASURED_MS {
            let off_mm = self.cell.controller.pose_deviation_mm();
            let what = format!("the pose is measured {off_mm} mm off, and contact has continued for {since_ms} ms");
            self.wrong("no contact at a pose far off", what);
        }
    }

    /// Returns whether the tip is on the panel and has just moved, while its epoch is open.
    fn is_in_contact(&self, moved: bool) -> bool {
        moved && !self.cell.controller.is_stopped() && self.height_mm() < MAX_CONTACT_HEIGHT_MM
    }
}

/// Returns the height of the tool's tip above the panel's surface, and its distance beside the outline, mm.
fn above_panel(base_from_flange: &Rigid<Base, Flange>) -> (f64, f64) {
    let fixture = Fixture::shared();
    let tool: Rigid<Base, Tool> = *base_from_flange * fixture.cycle.calibrations.flange_from_tool;
    let panel_from_base: Rigid<Panel, Base> = fixture.truth().base_from_panel.inverse();
    let tip: Point<Panel> = panel_from_base * tool.origin();
    (fixture.truth().distance_mm(tip), fixture.truth().outline_distance_mm(tip))
}

/// Returns the axis positions for the tool at this height above the panel's middle, perpendicular to the panel.
fn near_panel(height_mm: f64) -> Option<Joints> {
    let fixture = Fixture::shared();
    let truth = fixture.truth();
    let middle: Point<Panel> = Point::at(PANEL_MIDDLE_MM[0], PANEL_MIDDLE_MM[1], PANEL_MIDDLE_MM[2]);
    let normal = truth.normal(middle).mm.normalize();
    let tip = middle.mm - normal * (truth.distance_mm(middle) - height_mm);
    let z = -normal;
    let beside = if z.y.abs() < 0.9 { nalgebra::Vector3::y() } else { nalgebra::Vector3::x() };
    let x = beside.cross(&z).normalize();
    let arm = mock::Arm::kr6_r700_2();
    (0..8).find_map(|turn| {
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
        let turned = axes
            * Rotation3::from_axis_angle(
                &nalgebra::Vector3::z_axis(),
                f64::from(turn) * std::f64::consts::FRAC_PI_4,
            );
        let pose =
            Isometry3::from_parts(Translation3::from(tip.coords), UnitQuaternion::from_rotation_matrix(&turned));
        let panel_from_tool: Rigid<Panel, Tool> = Rigid::from_isometry_unchecked(pose);
        let base_from_tool: Rigid<Base, Tool> = truth.base_from_panel * panel_from_tool;
        let tool_from_flange: Rigid<Tool, Flange> = fixture.cycle.calibrations.flange_from_tool.inverse();
        let base_from_flange: Rigid<Base, Flange> = base_from_tool * tool_from_flange;
        let joints = arm.nearest(&base_from_flange, &START).ok()?;
        arm.within_limits(&joints).is_ok().then_some(joints)
    })
}
