//! The interlocks: the needs of each action, in the order in which they are satisfied, and the actions that satisfy them.
//! Each need is a row, so that a test can drop it and see that the random walks then fail.

use super::{Action, Epoch, Extraction, Facts, Frames, Lens, Light, Motion, Path, State, Switch, Tool, Water};

/// A condition that must be satisfied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Need {
    /// The robot reports standstill: no state is at rest before that.
    Standing,
    /// The self-test has passed: without it there is no Idle.
    Tested,
    /// The epoch is open: no command outside of it.
    Epoch,
    /// The epoch is ended.
    EpochEnded,
    /// The controller has echoed base and tool in this epoch: no straight motion before that.
    Frames(Frames),
    /// The arm is at the end of this path: parked for water and for the scanner's view, at its corner pose for a
    /// corner's picture, at the approach point, in air, for the start of the tool and of contact.
    At(Path),
    /// The tool is off: for every motion but contact, and for water.
    ToolOff,
    /// The tool is proven to run: no contact before that.
    ToolRunning,
    /// The water is off: for motion and film.
    WaterOff,
    /// The water has been off for the drain time: no start of the tool before that.
    Drained,
    /// The light is off: for 3D and corner pictures, and at rest.
    LightOff,
    /// The light is on and steady: for pictures of the film.
    LightSettled,
    /// The lens is not guarded: for each picture.
    LensClear,
    /// The lens is guarded: for water.
    LensGuarded,
    /// The extraction is off: at rest.
    ExtractionOff,
    /// The extraction reports flow: no tool without it.
    ExtractionFlowing,
    /// The localization is valid: for approach and contact.
    Token,
    /// The override is the one for which contact is planned: for tool and contact.
    FullOverride,
}

/// Returns the needs of an action. This is the whole list of the cell's interlocks.
pub(super) fn action_needs(act: Action) -> Vec<Need> {
    use Need as N;
    let (camera, pad) = (N::Frames(Frames::Camera), N::Frames(Frames::Pad));
    let (parked, at_approach) = (N::At(Path::Park), N::At(Path::Approach));
    match act {
        Action::CheckStandstill
        | Action::SelfTest
        | Action::OpenEpoch { .. }
        | Action::EndEpoch { .. }
        | Action::Plan { .. }
        | Action::Assess => vec![],
        // Water in the air and the film's light disturb the projected pattern, and an arm in view hides the panel.
        Action::Locate => vec![N::WaterOff, parked, N::LightOff, N::LensClear],
        Action::DryPicture => vec![N::WaterOff, parked, N::LightSettled, N::LensClear],
        Action::Film => vec![N::WaterOff, parked, N::LightSettled, N::LensClear],
        // The corner pose is last: light and lens are proven while the arm is still away, and nothing changes after it
        // arrives.
        Action::Refine { view } | Action::Verify { view } => {
            vec![N::LightOff, N::LensClear, N::At(Path::Corner { view })]
        }
        Action::Switch(Switch::Rinse | Switch::Spray) => {
            vec![N::Epoch, parked, N::ToolOff, N::LensGuarded]
        }
        Action::Switch(Switch::ToolOn) => {
            vec![N::FullOverride, N::Epoch, N::Drained, N::ExtractionFlowing, at_approach]
        }
        Action::Switch(_) | Action::SetFrames(_) => vec![N::Epoch],
        Action::Move(Motion { path, .. }) => match path {
            Path::Park => vec![N::Epoch, N::WaterOff, N::ToolOff],
            Path::Corner { .. } => vec![N::Epoch, N::WaterOff, N::ToolOff, camera],
            // The localization is needed already here: the approach point follows from it and is close to the panel.
            Path::Approach => vec![N::Epoch, N::Drained, N::ToolOff, N::Token, pad],
            Path::Contact => {
                // Last in the list: the tool starts at the approach point, in air, when everything else is proven. A
                // disc that starts on the panel digs in.
                let evidence = [N::FullOverride, N::Epoch, N::Drained, N::ExtractionFlowing, N::Token];
                [&evidence[..], &[at_approach, pad, N::ToolRunning]].concat()
            }
            Path::Air => vec![N::Epoch, N::WaterOff, N::ToolOff, N::Token, at_approach, pad],
            // No localization is needed: the tool must be able to leave the panel along its axis after the localization
            // became too old.
            Path::Retract => vec![N::Epoch, N::WaterOff, N::ToolOff, pad],
        },
    }
}

/// Returns the conditions of an action that are not satisfied, as texts; empty if the action may begin. It is used for
/// actions that a person requests one at a time: the same interlocks apply as in a cycle.
pub fn open_interlocks(act: Action, facts: &Facts) -> Vec<&'static str> {
    action_needs(act).into_iter().filter(|need| !need.is_satisfied(facts)).map(Need::describe_need).collect()
}

/// The needs that Stopping and Holding satisfy while a motion is in progress: its end comes first and switches off tool
/// and water.
pub(super) const LEAVE_MOTION_CONDITIONS: [Need; 1] = [Need::EpochEnded];

/// The needs that Stopping and Holding satisfy if the tool is commanded to run and no epoch is open. The end of an open
/// epoch would switch the tool off.
pub(super) const LEAVE_TOOL_CONDITIONS: [Need; 3] = [Need::ToolOff, Need::WaterOff, Need::EpochEnded];

/// The needs that Stopping and Holding satisfy otherwise. Water is shut while the epoch still accepts commands.
pub(super) const LEAVE_CONDITIONS: [Need; 2] = [Need::WaterOff, Need::EpochEnded];

/// The needs that Clearing satisfies.
pub(super) const CLEARING_CONDITIONS: [Need; 3] = [Need::Standing, Need::ToolOff, Need::WaterOff];

/// The needs that Resetting satisfies.
pub(super) const RESETTING_CONDITIONS: [Need; 6] =
    [Need::Standing, Need::ToolOff, Need::WaterOff, Need::ExtractionOff, Need::LightOff, Need::Tested];

/// The needs that Starting satisfies.
pub(super) const STARTING_CONDITIONS: [Need; 3] = [Need::WaterOff, Need::ToolOff, Need::At(Path::Park)];

/// The needs that Unholding satisfies.
pub(super) const UNHOLDING_CONDITIONS: [Need; 2] = [Need::WaterOff, Need::ToolOff];

/// The needs that Unholding satisfies if the panel had been located.
pub(super) const UNHOLDING_LOCATED_CONDITIONS: [Need; 3] = [Need::WaterOff, Need::ToolOff, Need::Token];

/// The needs that Completing satisfies.
pub(super) const COMPLETING_CONDITIONS: [Need; 5] =
    [Need::WaterOff, Need::ToolOff, Need::At(Path::Park), Need::ExtractionOff, Need::LightOff];

impl Need {
    /// Returns the condition as text, for a sentence that begins with "needs".
    fn describe_need(self) -> &'static str {
        match self {
            Need::Standing => "a robot at rest",
            Need::Tested => "a self-test",
            Need::Epoch => "an open epoch",
            Need::EpochEnded => "an ended epoch",
            Need::Frames(_) => "base and tool frames that the controller has confirmed",
            Need::At(Path::Park) => "the arm at the park pose",
            Need::At(Path::Approach) => "the arm at the approach point of a path, which only a cycle reaches",
            Need::At(_) => "the arm at the end of the previous path",
            Need::ToolOff => {
                "the tool off, by its output and by the feedback tool_running (and tool_stands, if the cell has it)"
            }
            Need::ToolRunning => "the tool on, proven by the feedback tool_running",
            Need::WaterOff => "the water off, proven by the feedback water_off",
            Need::Drained => "the water off for the drain time, which only a cycle measures",
            Need::LightOff => "the light off",
            Need::LightSettled => "the light on and settled",
            Need::LensClear => "a clear lens",
            Need::LensGuarded => "the lens shut, proven by the feedback lens_shut",
            Need::ExtractionOff => "the extraction off",
            Need::ExtractionFlowing => "the extraction on, proven by the feedback extraction_flow",
            Need::Token => "a valid localization",
            Need::FullOverride => "the controller's override at 100 %",
        }
    }

    /// Returns whether the condition is satisfied.
    pub fn is_satisfied(self, facts: &Facts) -> bool {
        match self {
            Need::Standing => facts.standing,
            Need::Tested => facts.tested,
            Need::Epoch => facts.epoch == Epoch::Open,
            Need::EpochEnded => facts.epoch == Epoch::Closed,
            Need::Frames(frames) => facts.frames == Some(frames),
            Need::At(path) => facts.arm == Some(path),
            Need::ToolOff => facts.tool == Tool::Off,
            Need::ToolRunning => facts.tool == Tool::Running,
            Need::WaterOff => facts.water_off(),
            Need::Drained => facts.water == Water::Drained,
            Need::LightOff => facts.light == Light::Off,
            Need::LightSettled => facts.light == Light::Settled,
            Need::LensClear => facts.lens == Lens::Clear,
            Need::LensGuarded => facts.lens == Lens::Guarded,
            Need::ExtractionOff => facts.extraction == Extraction::Off,
            Need::ExtractionFlowing => facts.extraction == Extraction::Flowing,
            Need::Token => facts.token.is_some(),
            Need::FullOverride => facts.full_override,
        }
    }

    /// Returns the action that satisfies the condition; `None` if only time or a person can satisfy it.
    pub fn satisfying_action(self, state: &State) -> Option<Action> {
        Some(match self {
            Need::Standing => Action::CheckStandstill,
            Need::Tested => Action::SelfTest,
            // It is unknown whether an epoch is open, so it is ended first.
            Need::Epoch if state.facts.epoch == Epoch::Changing => Action::EndEpoch { epoch: state.epoch },
            Need::Epoch => Action::OpenEpoch { above: state.epoch },
            Need::EpochEnded => Action::EndEpoch { epoch: state.epoch },
            Need::Frames(frames) => Action::SetFrames(frames),
            Need::At(path) => Action::Move(state.motion(path)),
            Need::ToolOff => Action::Switch(Switch::ToolOff),
            Need::ToolRunning => Action::Switch(Switch::ToolOn),
            Need::Drained if matches!(state.facts.water, Water::Draining { .. }) => return None,
            Need::WaterOff | Need::Drained => Action::Switch(Switch::WaterOff),
            Need::LightOff => Action::Switch(Switch::LightOff),
            Need::LightSettled if matches!(state.facts.light, Light::Settling { .. }) => return None,
            Need::LightSettled => Action::Switch(Switch::LightOn),
            Need::LensClear => Action::Switch(Switch::LensClear),
            Need::LensGuarded => Action::Switch(Switch::LensGuard),
            Need::ExtractionOff => Action::Switch(Switch::ExtractionOff),
            Need::ExtractionFlowing => Action::Switch(Switch::ExtractionOn),
            Need::Token => Action::Verify { view: state.job.verified },
            // Only a person at the pendant can change the override; `TransitionStep::perform_next_action` holds the
            // cycle until then.
            Need::FullOverride => return None,
        })
    }
}

impl State {
    /// Returns a motion along this path in the present epoch.
    pub(super) fn motion(&self, path: Path) -> Motion {
        let (plan, waypoints) =
            if matches!(path, Path::Contact | Path::Air) { (self.job.plan, self.job.waypoints) } else { (0, 1) };
        Motion { epoch: self.epoch, path, plan, waypoints }
    }
}
