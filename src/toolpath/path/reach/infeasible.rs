//! The reasons why an arm cannot follow a path, as text: which axis or part, how far, and the limit.

use panelprep_base::number_text::{distinguishable_texts, shortest_text};
use panelprep_cell::controller::RETRACT_MM;

/// Kinds of singularities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Singularity {
    /// Axes 4 and 6 are in line.
    Wrist,
    /// The arm is stretched.
    Elbow,
    /// The wrist's centre is over axis 1.
    Overhead,
}

/// The reason why an arm cannot follow a path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Infeasibility {
    /// A number is not finite.
    #[error("the pose is not a valid number")]
    NotFinite,
    /// The pose is too far or too near.
    #[error("the pose is {beyond_mm:.1} mm beyond the arm's reach")]
    OutOfReach {
        /// Distance beyond the reach, mm.
        beyond_mm: f64,
    },
    /// An axis exceeds its limits, which are reduced by the margin.
    #[error(
        "axis {axis} would be at {}°, the limits are {} to {}°", format_beyond(*angle_deg, *allowed_deg), shortest_text(allowed_deg[0]),
        shortest_text(allowed_deg[1])
    )]
    AxisLimit {
        /// 1 to 6.
        axis: usize,
        /// The angle that the axis would have, degrees.
        angle_deg: f64,
        /// Lowest and highest angle, reduced by the margins, degrees.
        allowed_deg: [f64; 2],
    },
    /// The arm is near a singularity.
    #[error("{} ({}, needed {})", describe_singularity(*singularity), distinguishable_texts(*found, *needed, 1)[0], distinguishable_texts(*found, *needed, 1)[1])]
    Singular {
        /// Kind of the singularity.
        singularity: Singularity,
        /// Distance from the singularity, degrees or mm.
        found: f64,
        /// The required distance.
        needed: f64,
    },
    /// The configuration would change.
    #[error(
        "axis {axis} would jump by {turn_deg:.0}°: the next pose is only reachable in another arm configuration"
    )]
    Flip {
        /// 1 to 6.
        axis: usize,
        /// Smallest jump, degrees.
        turn_deg: f64,
    },
    /// An axis is too fast.
    #[error(
        "axis {axis} would turn at {} °/s (limit {} °/s); lower feed_mm_s", distinguishable_texts(*needed_deg_s, *allowed_deg_s, 0)[0],
        distinguishable_texts(*needed_deg_s, *allowed_deg_s, 0)[1]
    )]
    AxisSpeed {
        /// 1 to 6.
        axis: usize,
        /// Speed needed, degrees a second.
        needed_deg_s: f64,
        /// Speed allowed, degrees a second.
        allowed_deg_s: f64,
    },
    /// The acceleration of an axis is too high.
    #[error(
        "axis {axis} would accelerate at {} °/s² (limit {} °/s²); lower feed_mm_s",
        distinguishable_texts(*needed_deg_s2, *allowed_deg_s2, 0)[0], distinguishable_texts(*needed_deg_s2, *allowed_deg_s2, 0)[1]
    )]
    AxisAcceleration {
        /// 1 to 6.
        axis: usize,
        /// Acceleration needed, degrees a second squared.
        needed_deg_s2: f64,
        /// Acceleration allowed, degrees a second squared.
        allowed_deg_s2: f64,
    },
    /// A part of the arm is in a keep-out box or too near to an obstacle.
    #[error(
        "the {part} would be {} mm from \"{name}\", at least {} mm are needed", distinguishable_texts(*distance_mm, *needed_mm, 0)[0],
        distinguishable_texts(*distance_mm, *needed_mm, 0)[1]
    )]
    KeepOut {
        /// Part of the arm or the tool.
        part: &'static str,
        /// The box.
        name: String,
        /// Distance, mm.
        distance_mm: f64,
        /// Distance needed, mm.
        needed_mm: f64,
    },
    /// After a stop in contact, the arm could not lift the tool off.
    #[error(
        "at a stop the controller lifts the tool by {} mm, which is not possible from this pose: {why}",
        RETRACT_MM
    )]
    Retract {
        /// The reason why the retract is not possible.
        why: Box<Infeasibility>,
    },
}

impl Infeasibility {
    /// Returns the code of the reason for which such a path is refused.
    pub fn code(&self) -> &'static str {
        match self {
            Infeasibility::Retract { .. } => "retract_out_of_reach",
            _ => "out_of_reach",
        }
    }
}

/// Formats an angle beyond its limits, with enough digits to distinguish it from the exceeded limit.
fn format_beyond(angle_deg: f64, [low_deg, high_deg]: [f64; 2]) -> String {
    let [angle, _] = distinguishable_texts(angle_deg, if angle_deg < low_deg { low_deg } else { high_deg }, 1);
    angle
}

fn describe_singularity(which: Singularity) -> &'static str {
    match which {
        Singularity::Wrist => "axis 5 would be too near its singularity, degrees",
        Singularity::Elbow => "the arm would be too near the elbow singularity (arm extended), degrees",
        Singularity::Overhead => "the wrist would be too near axis 1, mm",
    }
}

/// The place at which a path is refused, and the reason.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("waypoint {index}: {cause}")]
pub struct ReachFault {
    /// The waypoint at which, or on the motion to which, the problem occurs, from 0.
    pub index: usize,
    /// Cause of the fault.
    pub cause: Infeasibility,
}
