//! The facts about the cell: only what the cell has reported. A fact is unknown while a change of it is in progress.
//!
//! The facts agree with the robot link: if the link has ended an epoch, the epoch is not open here, in any state of the
//! cycle. If it is uncertain whether an epoch has ended, it is ended before the next one is opened.

use super::{Action, Frames, Id, Path, Robot, Switch};
use serde::{Deserialize, Serialize};

/// The facts that the interlocks need. A report makes a fact known; a command that changes it makes the fact unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Facts {
    /// The robot's condition.
    pub robot: Robot,
    /// Whether the controller's override is the one for which contact is planned.
    pub full_override: bool,
    /// Whether the robot has reported standstill since the last Reset or Clear.
    pub standing: bool,
    /// Whether the self-test has passed since the last Reset.
    pub tested: bool,
    /// Whether the controller accepts commands of [`State::epoch`](super::State).
    pub epoch: Epoch,
    /// Base and tool frames, as echoed by the controller in this epoch.
    pub frames: Option<Frames>,
    /// The path at whose end the arm is; `None` if the arm is elsewhere.
    pub arm: Option<Path>,
    /// Whether the pad may be in contact with the panel.
    pub touching: bool,
    /// The tool, or for `water_may_run` the water, was switched on and is not proven off, neither by its feedback
    /// nor by a person who cleared the cell. This stays after a lost link and after the end of the program.
    pub tool_may_run: bool,
    /// Whether the water may run; like `tool_may_run`.
    pub water_may_run: bool,
    /// Whether the sanding tool runs.
    pub tool: Tool,
    /// Whether rinse or spray runs.
    pub water: Water,
    /// The light for the film.
    pub light: Light,
    /// Whether the cameras' lenses are protected.
    pub lens: Lens,
    /// Whether the dust extraction runs.
    pub extraction: Extraction,
    /// The deadline until which the localization is valid; `None` without a valid localization.
    pub token: Option<Id>,
}

/// Whether the controller accepts commands of the cycle's epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Epoch {
    Closed,
    /// The opening or the end of the epoch was requested, but not answered yet.
    Changing,
    Open,
}

/// Whether the sanding tool runs, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Tool {
    Unknown,
    Off,
    Running,
}

/// Whether rinse or spray runs, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Water {
    Unknown,
    Rinsing { until: Id },
    Spraying { until: Id },
    Draining { until: Id },
    Drained,
}

/// The light for the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Light {
    Unknown,
    Off,
    Settling { until: Id },
    Settled,
}

/// Whether the cameras' lenses are protected, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Lens {
    Unknown,
    Clear,
    /// The lens shutters are closed, or the lenses are purged.
    Guarded,
}

/// Whether the dust extraction runs, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Extraction {
    Unknown,
    Off,
    Flowing,
}

impl Facts {
    /// The facts at the start of the program: nothing is known.
    pub const UNKNOWN: Facts = Facts {
        robot: Robot::Unknown,
        full_override: false,
        standing: false,
        tested: false,
        epoch: Epoch::Closed,
        frames: None,
        arm: None,
        touching: false,
        tool_may_run: false,
        water_may_run: false,
        tool: Tool::Unknown,
        water: Water::Unknown,
        light: Light::Unknown,
        lens: Lens::Unknown,
        extraction: Extraction::Unknown,
        token: None,
    };

    /// Returns whether both rinse and spray are off.
    pub fn water_off(&self) -> bool {
        matches!(self.water, Water::Draining { .. } | Water::Drained)
    }

    /// Returns the switches whose state is confirmed by these facts.
    pub fn proven_switches(&self) -> impl Iterator<Item = Switch> + use<> {
        let tool = match self.tool {
            Tool::Unknown => None,
            Tool::Off => Some(Switch::ToolOff),
            Tool::Running => Some(Switch::ToolOn),
        };
        let water = match self.water {
            Water::Unknown => None,
            Water::Rinsing { .. } => Some(Switch::Rinse),
            Water::Spraying { .. } => Some(Switch::Spray),
            Water::Draining { .. } | Water::Drained => Some(Switch::WaterOff),
        };
        let light = match self.light {
            Light::Unknown => None,
            Light::Off => Some(Switch::LightOff),
            Light::Settling { .. } | Light::Settled => Some(Switch::LightOn),
        };
        let lens = match self.lens {
            Lens::Unknown => None,
            Lens::Clear => Some(Switch::LensClear),
            Lens::Guarded => Some(Switch::LensGuard),
        };
        let extraction = match self.extraction {
            Extraction::Unknown => None,
            Extraction::Off => Some(Switch::ExtractionOff),
            Extraction::Flowing => Some(Switch::ExtractionOn),
        };
        [tool, extraction, water, lens, light].into_iter().flatten()
    }

    /// Marks the facts that an action changes as unknown, until the action is answered.
    pub(super) fn mark_unknown(&mut self, act: Action) {
        match act {
            Action::Move(motion) => {
                // During a motion, the arm is not at a pose that an interlock requires, so that no scan and no water
                // can begin.
                self.arm = None;
                self.touching |= motion.path == Path::Contact;
            }
            Action::OpenEpoch { .. } => self.epoch = Epoch::Changing,
            // The controller switches off the outputs of the epoch before it answers.
            Action::EndEpoch { .. } => self.end_epoch(Epoch::Changing),
            Action::SetFrames(_) => self.frames = None,
            Action::Switch(switch) => match switch {
                Switch::ToolOn => (self.tool, self.tool_may_run) = (Tool::Unknown, true),
                Switch::Rinse | Switch::Spray => (self.water, self.water_may_run) = (Water::Unknown, true),
                Switch::ToolOff => self.tool = Tool::Unknown,
                Switch::WaterOff => self.water = Water::Unknown,
                Switch::LightOn | Switch::LightOff => self.light = Light::Unknown,
                Switch::LensClear | Switch::LensGuard => self.lens = Lens::Unknown,
                Switch::ExtractionOn | Switch::ExtractionOff => self.extraction = Extraction::Unknown,
            },
            _ => {}
        }
    }

    /// Ends the epoch: the controller switches the outputs off with its own timers. The next epoch starts without base
    /// and tool frames.
    pub(super) fn end_epoch(&mut self, epoch: Epoch) {
        (self.epoch, self.frames) = (epoch, None);
        if self.tool != Tool::Off {
            self.tool = Tool::Unknown;
        }
        // An output that is confirmed to be off stays off, because the end of an epoch switches nothing on.
        if !self.water_off() {
            self.water = Water::Unknown;
        }
        if self.light != Light::Off {
            self.light = Light::Unknown;
        }
        if self.extraction != Extraction::Off {
            self.extraction = Extraction::Unknown;
        }
    }

    /// Marks the state of this switch as unknown; it must be confirmed again before an action needs it. A tool or water
    /// that was off may run now.
    pub(super) fn invalidate_switch(&mut self, switch: Switch) {
        // A contradictory feedback is treated like a command without an answer: the switch may be on or off until its
        // state is confirmed again.
        self.mark_unknown(Action::Switch(switch));
        self.tool_may_run |= switch == Switch::ToolOff;
        self.water_may_run |= switch == Switch::WaterOff;
    }

    /// Returns the facts that stay valid after a lost link and after a restart of the program.
    pub(super) fn facts_after_loss(&self) -> Facts {
        // Only facts that restrict the cell stay valid; facts that permit an action must be confirmed again.
        let Facts { touching, tool_may_run, water_may_run, .. } = *self;
        Facts { touching, tool_may_run, water_may_run, ..Facts::UNKNOWN }
    }

    /// Discards facts when the robot is no longer ready: a person may move the arm and switch outputs, and the
    /// localization is no longer valid.
    pub(super) fn forget(&mut self) {
        let lost = matches!(self.robot, Robot::Unknown | Robot::LinkLost | Robot::Restarted);
        // If the link is lost, the controller's watchdog has ended the epoch. If the guard is open, the link still
        // exists, and the epoch must be ended by a command.
        let epoch = if lost { Epoch::Closed } else { self.epoch };
        let full_override = self.full_override && !lost;
        *self = Facts { robot: self.robot, full_override, epoch, ..self.facts_after_loss() };
    }
}
