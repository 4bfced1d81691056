//! The rules of the table by name, so that a test can disable each one and see that the random walks then fail.

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

    /// Whether this rule is active.
    pub fn is_active(self, rule: Rule) -> bool {
        self.without != Some(rule)
    }

    /// Returns all rules except this one.
    #[cfg(test)]
    pub fn without(rule: Rule) -> Self {
        Rules { without: Some(rule) }
    }
}
