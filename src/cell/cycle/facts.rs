//! The facts about the cell: only what the cell has reported. A fact that is being changed is unknown.
//!
//! The facts agree with the robot link: an epoch that the link has ended is not open here, whatever the cycle was
//! doing. If it is not certain that an epoch has ended, it is ended before another one is opened.

use super::{Action, Frames, Id, Path, Robot, Switch};
use serde::{Deserialize, Serialize};

/// The facts that interlocks need. A report makes a fact known, and a request for a change makes it unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Facts {
    /// The robot's condition.
    pub robot: Robot,
    /// Whether the controller's override is the one for which contact is planned.
    #[serde(default)]
    pub full_override: bool,
    /// The robot has reported standstill since the last Reset or Clear.
    pub standing: bool,
    /// Whether the self-test has passed since the last Reset.
    pub tested: bool,
    /// Whether the controller accepts commands of [`State::epoch`](super::State).
    pub epoch: Epoch,
    /// Base and tool as the controller echoed them in this epoch.
    pub frames: Option<Frames>,
    /// The path at whose end the arm is.
    pub arm: Option<Path>,
    /// Whether the pad may be touching the panel.
    pub touching: bool,
    /// The tool, or for `water_may_run` the water, was switched on and is not proven off, neither by its feedback
    /// nor by a person who cleared the cell. This stays after a lost link and after the end of the program.
    #[serde(default)]
    pub tool_may_run: bool,
    /// Whether the water may run; like `tool_may_run`.
    #[serde(default)]
    pub water_may_run: bool,
    /// The sanding tool.
    pub tool: Tool,
    /// Rinse and spray.
    pub water: Water,
    /// The light for the film.
    pub light: Light,
    /// The cameras' lenses.
    pub lens: Lens,
    /// Dust extraction.
    pub extraction: Extraction,
    /// The localization may be used until this deadline.
    pub token: Option<Id>,
}

/// Whether the controller accepts commands of the cycle's epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Epoch {
    Closed,
    /// Opening or ending is requested and not answered.
    Changing,
    Open,
}

/// The sanding tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Tool {
    Unknown,
    Off,
    Running,
}

/// Rinse and spray.
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

/// The cameras' lenses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Lens {
    Unknown,
    Clear,
    /// The lens shutters are closed, or the lenses are purged.
    Guarded,
}

/// Dust extraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Extraction {
    Unknown,
    Off,
    Flowing,
}

impl Facts {
    /// The facts that a program knows when it starts.
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

    /// Returns whether neither rinse nor spray runs.
    pub fn water_off(&self) -> bool {
        matches!(self.water, Water::Draining { .. } | Water::Drained)
    }

    /// Returns the switches whose effect is proven by these facts.
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

    /// Marks the facts that an action changes as unknown until the action is answered.
    pub(super) fn mark_unknown(&mut self, act: Action) {
        match act {
            Action::Move(motion) => {
                // Between two poses the arm is at no place that an interlock knows, so that no scan or water can begin.
                self.arm = None;
                self.touching |= motion.path == Path::Contact;
            }
            Action::OpenEpoch { .. } => self.epoch = Epoch::Changing,
            // The outputs of the epoch are switched off before the action is answered.
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

    /// Ends the epoch: the controller, with its own timers, switches off the outputs that were on. The next epoch
    /// has neither base nor tool.
    pub(super) fn end_epoch(&mut self, epoch: Epoch) {
        (self.epoch, self.frames) = (epoch, None);
        if self.tool != Tool::Off {
            self.tool = Tool::Unknown;
        }
        // An output that was proven off stays off: the end of an epoch switches nothing on.
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

    /// Marks the state that this switch had proven as unknown; it is proven again before it is needed. A tool or
    /// water that was off may now run.
    pub(super) fn invalidate_switch(&mut self, switch: Switch) {
        // A contradiction is treated like a command without an answer: the switch is in either state until it is proven
        // again.
        self.mark_unknown(Action::Switch(switch));
        self.tool_may_run |= switch == Switch::ToolOff;
        self.water_may_run |= switch == Switch::WaterOff;
    }

    /// Returns the facts that stay valid after a loss of the robot's link and after the end of the program.
    pub(super) fn facts_after_loss(&self) -> Facts {
        // Only facts that restrict the cell stay valid after the link is lost; facts that permit an action are proven
        // again.
        let Facts { touching, tool_may_run, water_may_run, .. } = *self;
        Facts { touching, tool_may_run, water_may_run, ..Facts::UNKNOWN }
    }

    /// Discards facts when the robot is not ready: a person may move the arm and switch the outputs, and the
    /// localization is void.
    pub(super) fn forget(&mut self) {
        let lost = matches!(self.robot, Robot::Unknown | Robot::LinkLost | Robot::Restarted);
        // Without a link the controller has ended the epoch by its own watchdog. With an open guard it is still
        // connected, and the epoch must be ended by command.
        let epoch = if lost { Epoch::Closed } else { self.epoch };
        let full_override = self.full_override && !lost;
        *self = Facts { robot: self.robot, full_override, epoch, ..self.facts_after_loss() };
    }
}
