//! The path that was sent last, and how far a contact path in progress may continue.

use panelprep_base::geometry::{Base, Joints, Rigid, Tool};
use panelprep_cell::cycle::{Id, Motion, Path};
use panelprep_kuka::eki::CommandId;

/// The end of a path.
#[derive(Debug, Clone, Copy)]
pub(super) enum PathEndPose {
    Joints(Joints),
    Tip(Rigid<Base, Tool>),
}

/// The path that was sent last.
#[derive(Debug, Clone, Copy)]
pub(super) struct SentPath {
    pub id: Id,
    pub motion: Motion,
    pub first: CommandId,
    pub last: CommandId,
    pub end: PathEndPose,
    pub reported: u32,
}

impl SentPath {
    /// Returns which path was sent.
    pub fn path(&self) -> Path {
        self.motion.path
    }

    /// Returns the number of the command for the path's first waypoint.
    pub fn first_command(&self) -> CommandId {
        self.first
    }

    /// Returns the number of executed waypoints if all commands up to this one are executed.
    pub fn waypoints(&self, done: CommandId) -> u32 {
        if matches!(self.motion.path, Path::Contact | Path::Air) {
            (done.0 + 1).saturating_sub(self.first.0).min(self.motion.waypoints)
        } else {
            u32::from(done >= self.last) * self.motion.waypoints
        }
    }
}

/// Duration of the motion that is permitted ahead, in windows of the link. If it is less than `MIN_WINDOWS`, more
/// waypoints are permitted, up to `MAX_WINDOWS`.
const MIN_WINDOWS: f64 = 2.0;

const MAX_WINDOWS: f64 = 4.0;

/// Smallest number of waypoints that are permitted ahead, whatever their duration.
const MIN_AHEAD: u32 = 16;

/// The data of the contact path in progress that the record needs.
#[derive(Debug, Default)]
pub(super) struct PathProgress {
    /// Wear of the disc that is already counted for this path, mm².
    pub reserved_mm2: f64,
    /// The time at which each waypoint is reached at the planned feed, s; the first is the air point at which the
    /// path begins.
    reached_s: Vec<f64>,
    window_s: f64,
    /// Number of waypoints that may be sent.
    pub permitted: u32,
}

impl PathProgress {
    pub fn new(reached_s: Vec<f64>, window_s: f64) -> Self {
        let mut underway = PathProgress { reached_s, window_s, ..PathProgress::default() };
        underway.permitted = underway.new_permission(0).unwrap_or(0);
        underway
    }

    pub fn waypoint_count(&self) -> u32 {
        u32::try_from(self.reached_s.len().saturating_sub(1)).unwrap_or(u32::MAX)
    }

    fn time_of_waypoint_s(&self, waypoint: u32) -> f64 {
        self.reached_s.get(waypoint as usize).or(self.reached_s.last()).copied().unwrap_or(0.0)
    }

    /// Returns the new number of permitted waypoints after this many are executed; `None` if no more need to be
    /// permitted now.
    pub fn new_permission(&self, done: u32) -> Option<u32> {
        let (all, now_s) = (self.waypoint_count(), self.time_of_waypoint_s(done));
        let ahead_s = self.time_of_waypoint_s(self.permitted) - now_s;
        if self.permitted >= all
            || (ahead_s >= MIN_WINDOWS * self.window_s && self.permitted >= done.saturating_add(MIN_AHEAD / 2))
        {
            return None;
        }
        let until_s = now_s + MAX_WINDOWS * self.window_s;
        let by_time = u32::try_from(self.reached_s.partition_point(|at_s| *at_s < until_s)).unwrap_or(u32::MAX);
        let wanted = by_time.max(done.saturating_add(MIN_AHEAD)).min(all);
        (wanted > self.permitted).then_some(wanted)
    }
}
