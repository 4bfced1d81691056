//! The interlocks: the needs of each action, in the order in which they are brought about, and the actions that bring
//! them about.

use super::rules::Rule;
use super::{Action, Epoch, Extraction, Facts, Frames, Lens, Light, Motion, Path, State, Switch, Tool, Water};

/// A condition that must be satisfied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Need {
    Standing,
    Tested,
    Epoch,
    EpochEnded,
    Frames(Frames),
    At(Path),
    ToolOff,
    ToolRunning,
    WaterOff,
    Drained,
    LightOff,
    LightSettled,
    LensClear,
    LensGuarded,
    ExtractionOff,
    ExtractionFlowing,
    Token,
    FullOverride,
}

/// A need, with the rule that requires it.
pub(super) type Row = (Rule, Need);

/// Returns the needs of an action. This is the whole list of the cell's interlocks.
pub(super) fn action_needs(act: Action) -> Vec<Row> {
    use Need as N;
    use Rule as R;
    let parked = (R::ArmOutOfView, N::At(Path::Park));
    let (clear, dark) = ((R::LensClear, N::LensClear), (R::LightOff, N::LightOff));
    let lit = (R::LightSettled, N::LightSettled);
    let (dry_air, tool_off) = ((R::WaterOff, N::WaterOff), (R::ToolOff, N::ToolOff));
    let (camera, pad) = ((R::Frames, N::Frames(Frames::Camera)), (R::Frames, N::Frames(Frames::Pad)));
    let (drained, extraction) = ((R::Drained, N::Drained), (R::Extraction, N::ExtractionFlowing));
    let at_approach = (R::StartsInAir, N::At(Path::Approach));
    let corner = |view| (R::AtView, N::At(Path::Corner { view }));
    let (epoch, token) = ((R::Epoch, N::Epoch), (R::Token, N::Token));
    let full_override = (R::FullOverride, N::FullOverride);
    match act {
        Action::CheckStandstill
        | Action::SelfTest
        | Action::OpenEpoch { .. }
        | Action::EndEpoch { .. }
        | Action::Plan { .. }
        | Action::Assess => vec![],
        // Water in the air and the film's light disturb the projected pattern, and an arm in view hides the panel.
        Action::Locate => vec![dry_air, parked, dark, clear],
        Action::DryPicture => vec![dry_air, parked, lit, clear],
        Action::Film => vec![dry_air, parked, lit, clear],
        // The corner pose is last: light and lens are proven while the arm is still away, and nothing changes after it
        // arrives.
        Action::Refine { view } | Action::Verify { view } => vec![dark, clear, corner(view)],
        Action::Switch(Switch::Rinse | Switch::Spray) => {
            vec![epoch, (R::ParkedForWater, N::At(Path::Park)), tool_off, (R::LensGuarded, N::LensGuarded)]
        }
        Action::Switch(Switch::ToolOn) => vec![full_override, epoch, drained, extraction, at_approach],
        Action::Switch(_) | Action::SetFrames(_) => vec![epoch],
        Action::Move(Motion { path, .. }) => match path {
            Path::Park => vec![epoch, dry_air, tool_off],
            Path::Corner { .. } => vec![epoch, dry_air, tool_off, camera],
            // The localization is needed already here: the approach point follows from it and is close to the panel.
            Path::Approach => vec![epoch, drained, tool_off, token, pad],
            Path::Contact => {
                // Last in the list: the tool starts at the approach point, in air, when everything else is proven. A
                // disc that starts on the panel digs in.
                let running = (R::ToolRunning, N::ToolRunning);
                vec![full_override, epoch, drained, extraction, token, at_approach, pad, running]
            }
            Path::Air => vec![epoch, dry_air, tool_off, token, at_approach, pad],
            // No localization is needed: to leave the panel along the tool's axis must be possible after it became too
            // old.
            Path::Retract => vec![epoch, dry_air, tool_off, pad],
        },
    }
}

/// The needs of an action that are not satisfied, each as text; empty if the action may begin. For actions that a
/// person requests one at a time: they keep the interlocks of a cycle.
pub fn open_interlocks(act: Action, facts: &Facts) -> Vec<&'static str> {
    action_needs(act)
        .into_iter()
        .filter(|(_, need)| !need.is_satisfied(facts))
        .map(|(_, need)| need.describe_need())
        .collect()
}

/// The needs that Stopping and Holding bring about while a motion is in progress: its end comes first and switches
/// off tool and water.
pub(super) const LEAVING_MOTION: [Row; 1] = [(Rule::StandsFirst, Need::EpochEnded)];

/// What Stopping and Holding bring about if the tool is commanded to run and no epoch is open. The end of an open
/// epoch would switch the tool off.
pub(super) const LEAVING_TOOL: [Row; 3] =
    [(Rule::ToolOff, Need::ToolOff), (Rule::WaterOff, Need::WaterOff), (Rule::StandsFirst, Need::EpochEnded)];

/// What Stopping and Holding bring about. Water is shut while the epoch still accepts commands.
pub(super) const LEAVE_NEEDS: [Row; 2] = [(Rule::WaterOff, Need::WaterOff), (Rule::StandsFirst, Need::EpochEnded)];

/// The needs that Clearing brings about.
pub(super) const CLEARING: [Row; 3] =
    [(Rule::StandsFirst, Need::Standing), (Rule::ToolOff, Need::ToolOff), (Rule::WaterOff, Need::WaterOff)];

/// The needs that Resetting brings about.
pub(super) const RESETTING: [Row; 6] = [
    (Rule::StandsFirst, Need::Standing),
    (Rule::ToolOff, Need::ToolOff),
    (Rule::WaterOff, Need::WaterOff),
    (Rule::AllOff, Need::ExtractionOff),
    (Rule::AllOff, Need::LightOff),
    (Rule::SelfTest, Need::Tested),
];

/// The needs that Starting brings about.
pub(super) const STARTING: [Row; 3] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff), (Rule::ArmOutOfView, Need::At(Path::Park))];

/// The needs that Unholding brings about.
pub(super) const UNHOLDING: [Row; 2] = [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff)];

/// What Unholding brings about if the panel had been located.
pub(super) const UNHOLDING_LOCATED: [Row; 3] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff), (Rule::UnholdVerifies, Need::Token)];

/// The needs that Completing brings about.
pub(super) const COMPLETING: [Row; 5] = [
    (Rule::WaterOff, Need::WaterOff),
    (Rule::ToolOff, Need::ToolOff),
    (Rule::ArmOutOfView, Need::At(Path::Park)),
    (Rule::AllOff, Need::ExtractionOff),
    (Rule::AllOff, Need::LightOff),
];

impl Need {
    /// Returns the need as the end of a sentence that begins with "needs".
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

    /// Returns whether the need is satisfied.
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

    /// Returns the action that satisfies the need; `None` if only time or a person can satisfy it.
    pub fn satisfying_action(self, state: &State) -> Option<Action> {
        Some(match self {
            Need::Standing => Action::CheckStandstill,
            Need::Tested => Action::SelfTest,
            // It is not certain whether an epoch is open, so it is ended first.
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
            // Only a person at the pendant can change the override; `Turn::perform_next_action` holds the cycle until then.
            Need::FullOverride => return None,
        })
    }
}

impl State {
    /// Returns the motion along this path in the open epoch.
    pub(super) fn motion(&self, path: Path) -> Motion {
        let (plan, waypoints) =
            if matches!(path, Path::Contact | Path::Air) { (self.job.plan, self.job.waypoints) } else { (0, 1) };
        Motion { epoch: self.epoch, path, plan, waypoints }
    }
}
