//! The main run: moves the arm along the planned motions, one interpolation step at a time.
//!
//! LIN follows straight lines and blended corners at constant speed. The arm brakes only for a required stop: a motion
//! without a blend distance, the last planned motion, a change between LIN and PTP. If the next motion is not planned
//! when the start of a blend is passed, the blend becomes an exact stop. PTP moves all axes synchronously; the slowest
//! axis determines the speed. If an axis would exceed its maximum speed, the tool slows down, as with $CP_VEL_TYPE =
//! #VAR_ALL. If that does not help (at a singularity, or on a change of configuration), the motion fails. Not modelled:
//! jerk, centripetal acceleration in a blend, load. On lines the speed is planned ahead: all legs up to the next stop
//! limit it.

use super::kinematics::{Arm, Unreachable, angles_deg, to_joints};
use super::moves::{
    Corner, CornerBlend, Limits, Lin, Move, MoveKey, MoverLeg, Override, Pose, Ptp, ROUNDING_MM, distance_mm,
    measure_mm, pose_ahead, ramp_step,
};
use panelprep_base::geometry::{Base, Flange, Joints, Rigid, Tool};
use std::collections::VecDeque;

/// Time in which an axis accelerates to its maximum speed, s.
const AXIS_RAMP_S: f64 = 0.2;
/// Maximum number of times that a step is halved because an axis would be too fast.
const MAX_HALVINGS: i32 = 7;

/// $VEL.ORI1: the maximum rotation speed of the tool, degrees/s.
const MAX_ROTATION_DEG_S: f64 = 200.0;
/// Minimum deceleration of BRAKE on a line, mm/s².
const MIN_BRAKE_MM_S2: f64 = 5000.0;

/// A motion that was executed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CompletedMove {
    pub(super) step: Move,
    /// The axis angles at the end of the motion, or in the middle of its blend.
    pub(super) joints: Joints,
    /// Whether the arm stopped at the end of the motion because no further motion was planned in time. Commands that
    /// only wait in the ring buffer are ignored.
    pub(super) was_starved: bool,
}

/// The reason why the arm cannot follow its path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum MoveBlocked {
    Unreachable(Unreachable),
    /// This axis, 1 to 6, would exceed its maximum speed at any speed of the tool.
    AxisSpeed(usize),
}

/// The arm and its planned motions.
#[derive(Debug, Clone)]
pub(super) struct Mover {
    arm: Arm,
    joints: Joints,
    /// The planned motions; the first one is being executed.
    pub(super) planned: VecDeque<Move>,
    pub(super) place: MotionState,
    /// Distance covered on the current leg, mm, or degrees of the leading axis.
    pub(super) leg_distance: f64,
    /// Speed along the path, mm/s, or degrees/s of the leading axis.
    pub(super) speed: f64,
    pub(super) braking: bool,
    /// The legs up to the next stop; valid while neither the plan nor the current leg changes.
    cached_legs: Option<Vec<MoverLeg>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum MotionState {
    Standing,
    Line { from: Pose, length_mm: f64 },
    Corner { corner: Box<Corner>, passing: Option<Lin> },
    Axes { from: [f64; 6] },
}

impl Mover {
    pub(super) fn new(arm: Arm, joints: Joints) -> Self {
        let place = MotionState::Standing;
        Mover {
            arm,
            joints,
            planned: VecDeque::new(),
            place,
            leg_distance: 0.0,
            speed: 0.0,
            braking: false,
            cached_legs: None,
        }
    }

    pub(super) fn joints(&self) -> Joints {
        self.joints
    }

    /// Sets the axis angles of an arm at rest.
    pub(super) fn set_joints(&mut self, joints: Joints) {
        *self = Mover::new(self.arm, joints);
    }

    pub(super) fn base_from_flange(&self) -> Rigid<Base, Flange> {
        self.arm.base_from_flange(&self.joints)
    }

    /// Returns whether the arm is at rest and no motion is planned.
    pub(super) fn is_idle(&self) -> bool {
        self.place == MotionState::Standing && self.planned.is_empty()
    }

    /// Returns whether the arm is in motion.
    pub(super) fn is_in_motion(&self) -> bool {
        self.speed > 0.0
    }

    /// Returns whether the arm is at rest because its only planned motion is to be blended with the next one.
    pub(super) fn is_waiting_for_blend(&self) -> bool {
        let is_blended = matches!(self.planned.front(), Some(Move::Lin(lin)) if lin.blend_mm > 0.0);
        self.place == MotionState::Standing && self.planned.len() == 1 && is_blended
    }

    /// Returns whether the arm is braking to a stop, after which the remaining motions are discarded.
    pub(super) fn is_braking(&self) -> bool {
        self.braking
    }

    /// Returns the number of planned motions, including the current one.
    pub(super) fn planned_count(&self) -> usize {
        self.planned.len()
    }

    /// Returns the motion that is being executed.
    pub(super) fn current_move(&self) -> Option<&Move> {
        if self.place == MotionState::Standing { None } else { self.planned.front() }
    }

    /// Returns whether one of the planned motions, including the current one, ends in contact.
    pub(super) fn has_contact_ahead(&self) -> bool {
        self.planned.iter().any(Move::contact)
    }

    /// Returns the oldest motion that is not completed.
    pub(super) fn oldest_move(&self) -> Option<MoveKey> {
        let passing = match &self.place {
            MotionState::Corner { passing, .. } => passing.and_then(|lin| lin.key),
            _ => None,
        };
        passing.or_else(|| self.planned.front().and_then(Move::key))
    }

    /// Appends a motion to the plan; its target must be reachable from the end of the previous motion.
    pub(super) fn plan(&mut self, step: Move) {
        self.planned.push_back(step);
        self.cached_legs = None;
    }

    /// Plans to switch this output at the end of the last planned motion. Returns false if no motion is planned, or if
    /// the last one already switches an output.
    pub(super) fn switch_at_end(&mut self, output: (u16, bool)) -> bool {
        let switches = match self.planned.back_mut() {
            Some(Move::Lin(lin)) => &mut lin.switched_output,
            Some(Move::Ptp(ptp)) => &mut ptp.switched_output,
            None => return false,
        };
        self.cached_legs = None;
        let is_free = switches.is_none();
        switches.get_or_insert(output);
        is_free
    }

    /// Brakes to a stop on the path, and discards the remaining motions.
    pub(super) fn start_braking(&mut self) {
        self.braking = true;
        if self.speed == 0.0 {
            self.stop_immediately();
        }
    }

    /// Stops immediately and discards the remaining path.
    pub(super) fn stop_immediately(&mut self) {
        self.planned.clear();
        self.cached_legs = None;
        self.place = MotionState::Standing;
        self.speed = 0.0;
        self.braking = false;
    }

    /// Executes one interpolation step. Returns the motions whose end was reached or passed, and the reason if the arm
    /// cannot continue.
    pub(super) fn step(&mut self, allowed: Override, step_s: f64) -> (Vec<CompletedMove>, Option<MoveBlocked>) {
        if self.place == MotionState::Standing {
            self.begin_front_move();
        }
        let mut done = Vec::new();
        let blocked = match (&self.place, self.planned.front()) {
            (MotionState::Axes { from }, Some(&Move::Ptp(ptp))) => {
                let from = *from;
                done.extend(self.step_axes(from, ptp, allowed, step_s));
                None
            }
            (MotionState::Line { .. } | MotionState::Corner { .. }, _) => {
                self.step_lines(allowed, step_s, &mut done).err()
            }
            _ => None,
        };
        if blocked.is_some() {
            self.speed = 0.0; // what is left is the caller's to forget
        } else if self.braking && self.speed == 0.0 {
            self.stop_immediately();
        }
        (done, blocked)
    }

    fn begin_front_move(&mut self) {
        (self.leg_distance, self.speed, self.cached_legs) = (0.0, 0.0, None);
        match self.planned.front() {
            None => {}
            Some(Move::Lin(lin)) => {
                let from = self.base_from_flange() * lin.flange_from_tool;
                self.place = MotionState::Line { from, length_mm: distance_mm(&from, &lin.target) };
            }
            Some(Move::Ptp(_)) => self.place = MotionState::Axes { from: angles_deg(&self.joints) },
        }
    }

    fn step_axes(&mut self, from: [f64; 6], ptp: Ptp, allowed: Override, step_s: f64) -> Option<CompletedMove> {
        let to = angles_deg(&ptp.target);
        let way: [f64; 6] = std::array::from_fn(|axis| to[axis] - from[axis]);
        let lead_deg = way.iter().fold(0.0, |lead: f64, way_deg| lead.max(way_deg.abs()));
        // Returns the maximum speed of the leading axis at which no axis exceeds its own maximum.
        let pace = |share: f64| {
            let of_axis = |axis: usize| self.arm.speeds_deg_s[axis] * share * lead_deg / way[axis].abs();
            (0..6).filter(|&axis| way[axis] != 0.0).map(of_axis).fold(f64::INFINITY, f64::min)
        };
        let limits = Limits {
            to_stop: lead_deg - self.leg_distance,
            speed: if self.braking { 0.0 } else { pace((ptp.speed_share * allowed.share).min(allowed.axis_share)) },
            acceleration: pace(if self.braking { 1.0 } else { ptp.acceleration_share }) / AXIS_RAMP_S,
        };
        let (further, speed) = if lead_deg > 0.0 { ramp_step(self.speed, limits, step_s) } else { (0.0, 0.0) };
        self.leg_distance += further;
        self.speed = speed;
        if self.leg_distance < lead_deg {
            let share = self.leg_distance / lead_deg;
            self.joints = to_joints(std::array::from_fn(|axis| from[axis] + way[axis] * share));
            return None;
        }
        self.joints = ptp.target;
        self.planned.pop_front();
        self.place = MotionState::Standing;
        Some(CompletedMove { step: Move::Ptp(ptp), joints: self.joints, was_starved: self.planned.is_empty() })
    }

    fn step_lines(
        &mut self,
        allowed: Override,
        step_s: f64,
        done: &mut Vec<CompletedMove>,
    ) -> Result<(), MoveBlocked> {
        let legs = self.cached_legs.take().unwrap_or_else(|| self.legs_to_stop());
        let Some(flange_from_tool) = legs.first().map(|leg| leg.linear_motion().flange_from_tool) else {
            return Ok(());
        };
        let (further_mm, speed) = ramp_step(self.speed, self.line_limits(&legs, allowed, step_s), step_s);
        let mut share = 1.0;
        for halving in 0..=MAX_HALVINGS {
            let Some(pose) = pose_ahead(&legs, self.leg_distance + further_mm * share) else { break };
            let next = self.joints_at(&pose, &flange_from_tool).map_err(MoveBlocked::Unreachable)?;
            match self.too_fast(&next, step_s) {
                None => {
                    self.speed = if halving == 0 { speed } else { further_mm * share / step_s };
                    self.joints = next;
                    let same_leg =
                        self.advance(&legs, further_mm * share, done).map_err(MoveBlocked::Unreachable)?;
                    self.cached_legs = same_leg.then_some(legs);
                    return Ok(());
                }
                Some(axis) if halving == MAX_HALVINGS => return Err(MoveBlocked::AxisSpeed(axis)),
                Some(_) => share *= 0.5,
            }
        }
        Ok(())
    }

    fn joints_at(&self, pose: &Pose, flange_from_tool: &Rigid<Flange, Tool>) -> Result<Joints, Unreachable> {
        self.arm.nearest(&(*pose * flange_from_tool.inverse()), &self.joints)
    }

    fn too_fast(&self, next: &Joints, step_s: f64) -> Option<usize> {
        let (now, next) = (angles_deg(&self.joints), angles_deg(next));
        let fast = |axis: &usize| (next[*axis] - now[*axis]).abs() > self.arm.speeds_deg_s[*axis] * step_s + 1e-6;
        (0..6).find(fast).map(|axis| axis + 1)
    }

    /// Advances along the legs, and continues with the next leg at the end of each. Returns true if the arm is still on
    /// the first leg.
    fn advance(
        &mut self,
        legs: &[MoverLeg],
        further_mm: f64,
        done: &mut Vec<CompletedMove>,
    ) -> Result<bool, Unreachable> {
        self.leg_distance += further_mm;
        for (index, leg) in legs.iter().enumerate() {
            self.complete_blended_move(leg, done)?;
            if self.leg_distance < leg.length_mm() - ROUNDING_MM {
                return Ok(index == 0);
            }
            self.leg_distance -= leg.length_mm();
            match leg {
                MoverLeg::Line { lin, stops: true, .. } => {
                    self.planned.pop_front();
                    (self.place, self.leg_distance, self.speed) = (MotionState::Standing, 0.0, 0.0);
                    let starved = self.is_unintended_stop(lin);
                    done.push(CompletedMove { step: Move::Lin(*lin), joints: self.joints, was_starved: starved });
                    return Ok(false);
                }
                MoverLeg::Line { lin, .. } => {
                    self.planned.pop_front();
                    if let Some(MoverLeg::Corner { corner, .. }) = legs.get(index + 1) {
                        self.place = MotionState::Corner { corner: corner.clone(), passing: Some(*lin) };
                    }
                }
                MoverLeg::Corner { corner, .. } => {
                    self.place = MotionState::Line { from: corner.end, length_mm: corner.outgoing_length_mm };
                }
            }
        }
        Ok(false)
    }

    /// Returns whether a standstill at the end of this motion was not intended by the program.
    fn is_unintended_stop(&self, lin: &Lin) -> bool {
        match self.planned.front() {
            None => true,
            // The next motion was planned only after the start of the blend was passed.
            Some(Move::Lin(next)) => lin.blend_mm > 0.0 && distance_mm(&lin.target, &next.target) > ROUNDING_MM,
            Some(Move::Ptp(_)) => false,
        }
    }

    /// Completes a blended motion when the middle of its corner is reached.
    fn complete_blended_move(&mut self, leg: &MoverLeg, done: &mut Vec<CompletedMove>) -> Result<(), Unreachable> {
        let MotionState::Corner { corner, passing } = &mut self.place else { return Ok(()) };
        if self.leg_distance < corner.length_mm / 2.0 {
            return Ok(());
        }
        if let Some(lin) = passing.take() {
            let middle = leg.pose_at(leg.length_mm() / 2.0);
            let joints = self.joints_at(&middle, &lin.flange_from_tool)?;
            done.push(CompletedMove { step: Move::Lin(lin), joints, was_starved: false });
        }
        Ok(())
    }
}

impl Mover {
    fn line_limits(&self, legs: &[MoverLeg], allowed: Override, step_s: f64) -> Limits {
        let acceleration =
            legs.iter().map(|leg| leg.linear_motion().acceleration_mm_s2).fold(f64::INFINITY, f64::min);
        let (mut ahead_mm, mut speed) = (-self.leg_distance, f64::INFINITY);
        for leg in legs {
            // The limit is applied one step ahead, so that the speed can be reduced to that of the next leg before the
            // leg begins.
            let from_mm = (ahead_mm - self.speed * step_s).max(0.0);
            let own_mm_s = (leg.linear_motion().speed_mm_s * allowed.share).min(allowed.tool_mm_s);
            speed = speed.min((own_mm_s * own_mm_s + 2.0 * acceleration * from_mm).sqrt());
            ahead_mm += leg.length_mm();
        }
        if self.braking {
            return Limits { to_stop: ahead_mm, speed: 0.0, acceleration: acceleration.max(MIN_BRAKE_MM_S2) };
        }
        Limits { to_stop: ahead_mm, speed, acceleration }
    }

    /// Returns the current leg and the following ones up to the next stop.
    fn legs_to_stop(&self) -> Vec<MoverLeg> {
        let lins: Vec<Lin> = self
            .planned
            .iter()
            .map_while(|step| match step {
                Move::Lin(lin) => Some(*lin),
                Move::Ptp(_) => None,
            })
            .collect();
        let (mut legs, mut gone_mm) = (Vec::with_capacity(8), self.leg_distance);
        let (mut from, mut whole_mm) = match &self.place {
            MotionState::Line { from, length_mm: whole_mm } => (*from, *whole_mm),
            MotionState::Corner { corner, .. } => {
                gone_mm = 0.0;
                legs.extend(lins.first().map(|&lin| MoverLeg::Corner { corner: corner.clone(), lin }));
                (corner.end, corner.outgoing_length_mm)
            }
            MotionState::Standing | MotionState::Axes { .. } => return legs,
        };
        for (index, &lin) in lins.iter().enumerate() {
            let mm_per_deg = lin.speed_mm_s / MAX_ROTATION_DEG_S;
            let corner = lins.get(index + 1).and_then(|next| {
                let (vertex, next) = (lin.target, next.target);
                Corner::new(&CornerBlend {
                    incoming_pose: from,
                    incoming_length_mm: whole_mm,
                    vertex,
                    outgoing_end: next,
                    blend_mm: lin.blend_mm,
                    mm_per_deg,
                })
            });
            let line = |to: Pose, stops: bool| MoverLeg::Line {
                from,
                to,
                length_mm: measure_mm(&from, &to, mm_per_deg),
                lin,
                stops,
            };
            let blended = corner.map(|corner| (line(corner.start, false), corner));
            match blended {
                // A corner is not blended if the start of its blend was already passed.
                Some((to_blend, corner)) if gone_mm <= to_blend.length_mm() + ROUNDING_MM => {
                    (from, whole_mm) = (corner.end, corner.outgoing_length_mm);
                    legs.extend([to_blend, MoverLeg::Corner { corner: Box::new(corner), lin }]);
                }
                _ => {
                    legs.push(line(lin.target, true));
                    break;
                }
            }
            gone_mm = 0.0;
        }
        legs
    }
}
