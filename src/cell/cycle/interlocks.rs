//! The rules of the table by name, so that a test can disable each one and see that the random walks then fail; and the
//! interlocks: the needs of each action, in the order in which they are satisfied, and the actions that satisfy them.

use super::{Action, Epoch, Extraction, Facts, Frames, Lens, Light, Motion, Path, State, Switch, Tool, Water};

/// The rules of the table. In the code, each rule is named at the place where it is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(test, derive(strum::EnumIter))] // a new rule is taken out in turn, too
pub(super) enum Rule {
    // Interlocks: rows of `interlocks::action_needs`.
    /// No shot of the scanner while the arm is in view.
    ArmOutOfView,
    /// A corner picture is taken from its corner pose.
    AtView,
    /// Light off for 3D and corner pictures.
    LightOff,
    /// Light on and steady for pictures of the film.
    LightSettled,
    /// No picture through a guarded lens.
    LensClear,
    /// No water while the lens is not guarded.
    LensGuarded,
    /// No water unless the arm is parked.
    ParkedForWater,
    /// Water off for motion and film.
    WaterOff,
    /// Tool off for every motion but contact, and for water.
    ToolOff,
    /// No start of the tool until the water has been off for the drain time.
    Drained,
    /// No tool without extraction that reports flow.
    Extraction,
    /// The tool starts at the approach point, in air, and contact begins there.
    StartsInAir,
    /// No contact before the tool is proven to run.
    ToolRunning,
    /// No tool and no contact with another override than the one for which contact is planned.
    FullOverride,
    /// No approach and no contact without a valid localization.
    Token,
    /// No straight motion before the controller has echoed base and tool in this epoch.
    Frames,
    /// No command outside an open epoch.
    Epoch,
    /// A motion ends when the robot reports standstill; no state is at rest before that.
    StandsFirst,
    /// Everything is switched off in Idle and Complete.
    AllOff,
    /// No Idle without a self-test.
    SelfTest,
    // The reports that the table accepts as true: `step`.
    /// An answer counts only for the action whose id it contains.
    AnswersMatch,
    /// A fact that is being changed is unknown.
    AskedIsUnknown,
    /// A request that leads to motion is refused while the robot is not ready.
    RobotReady,
    /// If the robot becomes not ready, the work ends.
    ConditionAborts,
    /// If an output or feedback contradicts the state that it proved, this proof is void.
    ContraryDoubts,
    /// A robot that is not ready voids the localization, and the knowledge of arm and outputs.
    LossForgets,
    /// A motion is committed to the store before it begins.
    IntentFirst,
    /// Waypoints are executed in order.
    Sequence,
    /// A motion is finished only when its last waypoint is executed.
    WholePath,
    /// An action that is not answered in time is a fault.
    AnswerDeadline,
    /// A stop that lasts too long is a fault.
    StopDeadline,
    /// Trouble ends the work.
    TroubleLeaves,
    /// An abort is sent to the robot.
    AbortIsSent,
    /// An epoch that the link has ended counts as not open.
    LinkEndsEpoch,
    /// A program that starts is at rest.
    BootRests,
    // The order of the phases: `execute`.
    /// A rejected result ends the cycle without contact.
    RejectEnds,
    /// A doubtful result is held for a person.
    ReviewHolds,
    /// A film without a result ends the cycle.
    InvalidEnds,
    /// An air-run makes no contact, and needs no water film to determine its path.
    AirRun,
    /// A dry picture is taken before the first water.
    DryPicture,
    /// If the recipe's reference is a dry picture, a new one of the dried panel is taken after each abrasion.
    DryAfterAbrasion,
    /// Verify immediately before each contact.
    VerifyFirst,
    /// After a contact path, nothing else is done before the result is graded.
    AssessFirst,
    /// A new localization does not replace a person's review of a contact path's result.
    ContactStays,
    /// Contact ends when the localization is too old.
    TokenInContact,
    /// A hold ends through Verify.
    UnholdVerifies,
    /// After a spray, no 3D shot before a person confirms that the panel is dry.
    DriedFirst,
    /// The limit for moves of the corner loop.
    MoveLimit,
    /// The limit for abrasions.
    PassLimit,
}

/// The active rules: all of them, except in tests.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    without: Option<Rule>,
}

impl Rules {
    /// Every rule.
    pub const ALL: Rules = Rules { without: None };

    /// Returns whether this rule is active.
    pub fn is_active(self, rule: Rule) -> bool {
        self.without != Some(rule)
    }

    /// Returns all rules except this one.
    #[cfg(test)]
    pub fn without(rule: Rule) -> Self {
        Rules { without: Some(rule) }
    }
}

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
            // No localization is needed: the tool must be able to leave the panel along its axis after the localization
            // became too old.
            Path::Retract => vec![epoch, dry_air, tool_off, pad],
        },
    }
}

/// Returns the needs of an action that are not satisfied, each as text; empty if the action may begin. It is used for
/// actions that a person requests one at a time: the interlocks of a cycle apply to them as well.
pub fn open_interlocks(act: Action, facts: &Facts) -> Vec<&'static str> {
    action_needs(act)
        .into_iter()
        .filter(|(_, need)| !need.is_satisfied(facts))
        .map(|(_, need)| need.describe_need())
        .collect()
}

/// The needs that Stopping and Holding satisfy while a motion is in progress: its end comes first and switches off tool
/// and water.
pub(super) const LEAVING_MOTION: [Row; 1] = [(Rule::StandsFirst, Need::EpochEnded)];

/// The needs that Stopping and Holding satisfy if the tool is commanded to run and no epoch is open. The end of an open
/// epoch would switch the tool off.
pub(super) const LEAVING_TOOL: [Row; 3] =
    [(Rule::ToolOff, Need::ToolOff), (Rule::WaterOff, Need::WaterOff), (Rule::StandsFirst, Need::EpochEnded)];

/// The needs that Stopping and Holding satisfy otherwise. Water is shut while the epoch still accepts commands.
pub(super) const LEAVE_NEEDS: [Row; 2] = [(Rule::WaterOff, Need::WaterOff), (Rule::StandsFirst, Need::EpochEnded)];

/// The needs that Clearing satisfies.
pub(super) const CLEARING: [Row; 3] =
    [(Rule::StandsFirst, Need::Standing), (Rule::ToolOff, Need::ToolOff), (Rule::WaterOff, Need::WaterOff)];

/// The needs that Resetting satisfies.
pub(super) const RESETTING: [Row; 6] = [
    (Rule::StandsFirst, Need::Standing),
    (Rule::ToolOff, Need::ToolOff),
    (Rule::WaterOff, Need::WaterOff),
    (Rule::AllOff, Need::ExtractionOff),
    (Rule::AllOff, Need::LightOff),
    (Rule::SelfTest, Need::Tested),
];

/// The needs that Starting satisfies.
pub(super) const STARTING: [Row; 3] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff), (Rule::ArmOutOfView, Need::At(Path::Park))];

/// The needs that Unholding satisfies.
pub(super) const UNHOLDING: [Row; 2] = [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff)];

/// The needs that Unholding satisfies if the panel had been located.
pub(super) const UNHOLDING_LOCATED: [Row; 3] =
    [(Rule::WaterOff, Need::WaterOff), (Rule::ToolOff, Need::ToolOff), (Rule::UnholdVerifies, Need::Token)];

/// The needs that Completing satisfies.
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
