//! The moves that can be planned for the arm.

use super::corner::Pose;
use panelprep_base::geometry::{Flange, Joints, Rigid, Tool};

/// The command to which a move belongs; a retract belongs to no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MoveKey {
    pub(super) epoch: i32,
    pub(super) id: i32,
}

/// A linear motion of the TCP.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lin {
    pub(super) key: Option<MoveKey>,
    pub(super) target: Pose,
    pub(super) flange_from_tool: Rigid<Flange, Tool>,
    /// Blend distance, mm; 0 for an exact stop.
    pub(super) blend_mm: f64,
    pub(super) contact: bool,
    /// An output that is switched at the end of the move.
    pub(super) switched_output: Option<(u16, bool)>,
    /// Number of points still to come on this path.
    pub(super) remaining_points: i32,
    pub(super) speed_mm_s: f64,
    pub(super) acceleration_mm_s2: f64,
}

/// A PTP motion of the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ptp {
    pub(super) key: Option<MoveKey>,
    pub(super) target: Joints,
    /// Speed as a share of each axis's highest speed, 0…1.
    pub(super) speed_share: f64,
    /// Acceleration as a share of each axis's highest acceleration, 0…1.
    pub(super) acceleration_share: f64,
    /// An output that is switched at the end of the move.
    pub(super) switched_output: Option<(u16, bool)>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Move {
    Lin(Lin),
    Ptp(Ptp),
}

impl Move {
    pub(super) fn key(&self) -> Option<MoveKey> {
        match self {
            Move::Lin(lin) => lin.key,
            Move::Ptp(ptp) => ptp.key,
        }
    }

    pub(super) fn contact(&self) -> bool {
        matches!(self, Move::Lin(lin) if lin.contact)
    }

    pub(super) fn switched_output(&self) -> Option<(u16, bool)> {
        match self {
            Move::Lin(lin) => lin.switched_output,
            Move::Ptp(ptp) => ptp.switched_output,
        }
    }
}

/// The speeds that the mode permits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Override {
    pub(super) tool_mm_s: f64,
    pub(super) axis_share: f64,
    /// $OV_PRO as a fraction of every programmed speed, 0…1.
    pub(super) share: f64,
}

/// Lengths that differ by less than this are equal, mm.
pub(super) const ROUNDING_MM: f64 = 1e-9;
