//! The rules of the state table, and the interlocks. Each rule has a name, so that a test can disable it and check that
//! the random walks then fail. The interlocks are the conditions of each action, in the order in which they are
//! established, and the actions that establish them.

use super::{Action, Epoch, Extraction, Facts, Frames, Lens, Light, Motion, Path, State, Switch, Tool, Water};

/// The rules of the state table. The code names each rule where it applies the rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(test, derive(strum::EnumIter))] // a new rule is taken out in turn, too
pub(super) enum Rule {
    // Rules of the interlocks, used in `interlocks::action_needs`.
    /// The scanner captures only while the arm is out of its view.
    ArmOutOfView,
    /// A corner picture is captured only at its corner pose.
    AtView,
    /// The light is off for 3D shots and corner pictures.
    LightOff,
    /// The light is on and stable for pictures of the film.
    LightSettled,
    /// Pictures are captured only with open lens shutters.
    LensClear,
    /// Water is switched on only while the lenses are protected.
    LensGuarded,
    /// Water is switched on only while the arm is parked.
    ParkedForWater,
    /// The water is off during motions and during the observation of the film.
    WaterOff,
    /// The tool is off during all motions except contact, and while water runs.
    ToolOff,
    /// The tool starts only after the water has been off for the drain time.
    Drained,
    /// The tool starts only while the extraction reports flow.
    Extraction,
    /// The tool starts at the approach point in the air, where the contact path begins.
    StartsInAir,
    /// Contact begins only after the feedback has confirmed that the tool runs.
    ToolRunning,
    /// The tool runs and contact takes place only at the override for which contact is planned.
    FullOverride,
    /// Approach and contact need a valid localization.
    Token,
    /// Linear motions need base and tool frames that the controller has echoed in this epoch.
    Frames,
    /// Commands are sent only in an open epoch.
    Epoch,
    /// A motion ends only when the robot reports standstill; no state is at rest before.
    StandsFirst,
    /// All outputs are off in Idle and Complete.
    AllOff,
    /// Idle is reached only after a self-test.
    SelfTest,
    // Rules about the reports that the table accepts, used in `step`.
    /// An answer is accepted only for the action whose id it contains.
    AnswersMatch,
    /// A fact is unknown while a change of it is in progress.
    AskedIsUnknown,
    /// A request that leads to a motion is refused while the robot is not ready.
    RobotReady,
    /// The work ends when the robot is no longer ready.
    ConditionAborts,
    /// The state of a switch becomes unknown if its output or feedback contradicts it.
    ContraryDoubts,
    /// When the robot is no longer ready, the localization and the facts about arm and outputs become invalid.
    LossForgets,
    /// A motion is committed to the store before it begins.
    IntentFirst,
    /// Waypoints are executed in order.
    Sequence,
    /// A motion is complete only when its last waypoint is executed.
    WholePath,
    /// A missing answer to an action is a fault after the time limit.
    AnswerDeadline,
    /// A stop that exceeds its time limit is a fault.
    StopDeadline,
    /// A fault ends the work.
    TroubleLeaves,
    /// An abort sends the abort frame to the robot.
    AbortIsSent,
    /// An epoch that the link has ended is treated as not open.
    LinkEndsEpoch,
    /// After a start of the program, the state is at rest.
    BootRests,
    // Rules about the order of the phases, used in `execute`.
    /// A rejected result ends the cycle without contact.
    RejectEnds,
    /// The cycle is held for a person if a result needs review.
    ReviewHolds,
    /// A film without a valid result ends the cycle.
    InvalidEnds,
    /// An air-run makes no contact, and plans its path without a film.
    AirRun,
    /// A picture of the dry panel is captured before the first water.
    DryPicture,
    /// If the recipe compares with a dry picture, a new one is captured after each sanding pass, when the panel is dry
    /// again.
    DryAfterAbrasion,
    /// The pose of the panel is verified immediately before each contact.
    VerifyFirst,
    /// After a contact path, its result is graded before anything else is done.
    AssessFirst,
    /// If a person must review the result of a contact path, a new localization does not replace the review.
    ContactStays,
    /// Contact ends when the localization becomes too old.
    TokenInContact,
    /// A held cycle is resumed only through Verify.
    UnholdVerifies,
    /// After the panel was sprayed, a 3D shot needs a person's confirmation that the panel is dry.
    DriedFirst,
    /// The number of motions in the corner loop is limited.
    MoveLimit,
    /// The number of sanding passes is limited.
    PassLimit,
}

/// The active rules: all rules, except in tests.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    without: Option<Rule>,
}

impl Rules {
    /// All rules are active.
    pub const ALL: Rules = Rules { without: None };

    /// Returns whether this rule is active.
    pub fn is_active(self, rule: Rule) -> bool {
        self.without != Some(rule)
    }

    /// Returns all rules except `rule`.
    #[cfg(test)]
    pub fn without(rule: Rule) -> Self {
        Rules { without: Some(rule) }
    }
}

/// A condition of an action or a state.
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

/// A condition, with the rule that requires it.
pub(super) type Row = (Rule, Need);

/// Returns the conditions of an action. This is the complete list of the cell's interlocks.
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
        // Spray in the air and the light for the film disturb the projected pattern, and an arm in the view hides the
        // panel.
        Action::Locate => vec![dry_air, parked, dark, clear],
        Action::DryPicture => vec![dry_air, parked, lit, clear],
        Action::Film => vec![dry_air, parked, lit, clear],
        // The corner pose is the last condition: light and lens are checked before the arm arrives, and nothing is
        // switched afterwards.
        Action::Refine { view } | Action::Verify { view } => vec![dark, clear, corner(view)],
        Action::Switch(Switch::Rinse | Switch::Spray) => {
            vec![epoch, (R::ParkedForWater, N::At(Path::Park)), tool_off, (R::LensGuarded, N::LensGuarded)]
        }
        Action::Switch(Switch::ToolOn) => vec![full_override, epoch, drained, extraction, at_approach],
        Action::Switch(_) | Action::SetFrames(_) => vec![epoch],
        Action::Move(Motion { path, .. }) => match path {
            Path::Park => vec![epoch, dry_air, tool_off],
            Path::Corner { .. } => vec![epoch, dry_air, tool_off, camera],
            // A localization is needed already for the approach: the approach point is computed from it and is close to
            // the panel.
            Path::Approach => vec![epoch, drained, tool_off, token, pad],
            Path::Contact => {
                // This condition is the last one: the tool starts at the approach point, in the air, after all other
                // conditions are satisfied. A disc that starts on the panel would damage it.
                let running = (R::ToolRunning, N::ToolRunning);
                vec![full_override, epoch, drained, extraction, token, at_approach, pad, running]
            }
            Path::Air => vec![epoch, dry_air, tool_off, token, at_approach, pad],
            // A retract needs no localization: the tool must be able to leave the panel along its axis even if the
            // localization is too old.
            Path::Retract => vec![epoch, dry_air, tool_off, pad],
        },
    }
}

/// Returns the conditions of an action that are not satisfied, as texts; empty if the action may begin. It is used for
/// actions that a person requests one at a time: the same interlocks apply as in a cycle.
pub fn open_interlocks(act: Action, facts: &Facts) -> Vec<&'static str> {
    action_needs(act)
        .into_iter()
        .filter(|(_, need)| !need.is_satisfied(facts))
        .map(|(_, need)| need.describe_need())
        .collect()
}

/// Conditions of Stopping and Holding during a motion: the end of the epoch stops the motion and switches tool and
/// water off.
pub(super) const LEAVE_MOTION_CONDITIONS: [Row; 1] = [(Rule::StandsFirst, Need::EpochEnded)];

/// Conditions of Stopping and Holding if the tool was switched on and no epoch is open. In an open epoch, the end of
/// the epoch would switch the tool off.
pub(super) const LEAVE_TOOL_CONDITIONS: [Row; 3] =
    [(Rule::ToolOff, Need::ToolOff), (Rule::WaterOff, Need::WaterOff), (Rule::StandsFirst, Need::EpochEnded)];

/// Conditions of Stopping and Holding in all other cases. The water is switched off first, while the epoch still
/// accepts commands.
pub(super) const LEAVE_CONDITIONS: [Row; 2] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::StandsFirst, Need::EpochEnded)];

/// Conditions at the end of Clearing.
pub(super) const CLEARING_CONDITIONS: [Row; 3] =
    [(Rule::StandsFirst, Need::Standing), (Rule::ToolOff, Need::ToolOff), (Rule::WaterOff, Need::WaterOff)];

/// Conditions at the end of Resetting.
pub(super) const RESETTING_CONDITIONS: [Row; 6] = [
    (Rule::StandsFirst, Need::Standing),
    (Rule::ToolOff, Need::ToolOff),
    (Rule::WaterOff, Need::WaterOff),
    (Rule::AllOff, Need::ExtractionOff),
    (Rule::AllOff, Need::LightOff),
    (Rule::SelfTest, Need::Tested),
];

/// Conditions at the end of Starting.
pub(super) const STARTING_CONDITIONS: [Row; 3] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff), (Rule::ArmOutOfView, Need::At(Path::Park))];

/// Conditions at the end of Unholding.
pub(super) const UNHOLDING_CONDITIONS: [Row; 2] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff)];

/// Conditions at the end of Unholding if the panel was located before the hold.
pub(super) const UNHOLDING_LOCATED_CONDITIONS: [Row; 3] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff), (Rule::UnholdVerifies, Need::Token)];

/// Conditions at the end of Completing.
pub(super) const COMPLETING_CONDITIONS: [Row; 5] = [
    (Rule::WaterOff, Need::WaterOff),
    (Rule::ToolOff, Need::ToolOff),
    (Rule::ArmOutOfView, Need::At(Path::Park)),
    (Rule::AllOff, Need::ExtractionOff),
    (Rule::AllOff, Need::LightOff),
];

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
            // Only a person at the pendant can change the override; `Turn::perform_next_action` holds the cycle
            // meanwhile.
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
