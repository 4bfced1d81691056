//! The state of one epoch: the ring of commands, base and tool, speeds. None of this outlives the epoch.

use super::wire::{Command, Refusal};
use panelprep_base::geometry::{Flange, KukaPose, Rigid, Tool};
use std::collections::VecDeque;

/// Number of entries in the ring.
pub(super) const RING: usize = 100;

#[derive(Debug, Clone)]
pub(super) struct Epoch {
    pub(super) number: i32,
    /// Commands are accepted; false once the epoch has ended.
    pub(super) open: bool,
    pub(super) last_received: i32,
    pub(super) last_executed: i32,
    /// The first refusal and the id of the refused command.
    pub(super) refusal: Option<(Refusal, i32)>,
    /// Commands that were received and are not yet planned.
    pub(super) ring: VecDeque<Command>,
    pub(super) base: Option<KukaPose>,
    pub(super) tool: Option<ActiveTool>,
    pub(super) speed_mm_s: f64,
    pub(super) acceleration_mm_s2: f64,
    /// Acceleration as a share of each axis's highest acceleration, 0…1.
    pub(super) axis_acceleration_share: f64,
    /// The time until which the subroutine at the ring's front runs.
    pub(super) subroutine_until_ms: Option<u64>,
}

/// $TOOL.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActiveTool {
    pub(super) pose: KukaPose,
    pub(super) sanding: bool,
}

impl ActiveTool {
    pub(super) fn flange_from_tool(&self) -> Rigid<Flange, Tool> {
        self.pose.to_rigid()
    }
}

impl Epoch {
    /// Returns an epoch that accepts no commands.
    pub(super) fn closed(number: i32) -> Self {
        Epoch {
            number,
            open: false,
            last_received: 0,
            last_executed: 0,
            refusal: None,
            ring: VecDeque::new(),
            base: None,
            tool: None,
            speed_mm_s: 100.0,
            acceleration_mm_s2: 1000.0,
            axis_acceleration_share: 0.5,
            subroutine_until_ms: None,
        }
    }

    /// Creates a new epoch, without base and tool.
    pub(super) fn new_open(number: i32) -> Self {
        Epoch { open: true, ..Epoch::closed(number) }
    }

    pub(super) fn free_entries(&self) -> usize {
        RING.saturating_sub(self.ring.len())
    }
}
