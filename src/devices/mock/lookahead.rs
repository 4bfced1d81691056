//! The path ahead of the tool on its lines: the legs up to the next stop, and the permitted speed.

use super::corner::{Corner, CornerBlend, Pose, measure_mm};
use super::legs::MoverLeg;
use super::mover::{MotionState, Mover};
use super::moves::{Lin, Move, Override, ROUNDING_MM};
use super::ramp::Limits;

/// $VEL.ORI1: the highest rotational speed of the tool, degrees/s.
const TURN_DEG_S: f64 = 200.0;
/// Smallest deceleration of BRAKE on a line, mm/s².
const BRAKE_MM_S2: f64 = 5000.0;

impl Mover {
    pub(super) fn line_limits(&self, legs: &[MoverLeg], allowed: Override, step_s: f64) -> Limits {
        let acceleration =
            legs.iter().map(|leg| leg.linear_motion().acceleration_mm_s2).fold(f64::INFINITY, f64::min);
        let (mut ahead_mm, mut speed) = (-self.leg_distance, f64::INFINITY);
        for leg in legs {
            // Limits the speed here, one step ahead, so that it can be reduced to that leg's speed by the leg's
            // start.
            let from_mm = (ahead_mm - self.speed * step_s).max(0.0);
            let own_mm_s = (leg.linear_motion().speed_mm_s * allowed.share).min(allowed.tool_mm_s);
            speed = speed.min((own_mm_s * own_mm_s + 2.0 * acceleration * from_mm).sqrt());
            ahead_mm += leg.length_mm();
        }
        if self.braking {
            return Limits { to_stop: ahead_mm, speed: 0.0, acceleration: acceleration.max(BRAKE_MM_S2) };
        }
        Limits { to_stop: ahead_mm, speed, acceleration }
    }

    /// Returns the present leg and those that follow, up to the next stop.
    pub(super) fn legs_to_stop(&self) -> Vec<MoverLeg> {
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
            let mm_per_deg = lin.speed_mm_s / TURN_DEG_S;
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
                // A blend is not made if its start was already passed.
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
