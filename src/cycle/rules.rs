//! The rules of the table by name, so that a test can disable each one and see that the random walks then fail.

/// Each rule has its place in the code beside its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(test, derive(strum::EnumIter))] // a new rule is taken out in turn, too
pub(super) enum Rule {
    // Interlocks: rows of `interlocks::needs`.
    /// No shot of the scanner with the arm in view.
    ArmOutOfView,
    /// A corner picture is taken from its corner pose.
    AtView,
    /// Light off for 3D and corner pictures.
    LightOff,
    /// Light on and settled for pictures of the film.
    LightSettled,
    /// No picture through a guarded lens.
    LensClear,
    /// No water on an open lens.
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
    /// No contact before the tool is proven running.
    ToolRunning,
    /// No tool and no contact at another override than contact is planned for.
    FullOverride,
    /// No approach and no contact without a live localization.
    Token,
    /// No straight motion before base and tool were echoed in this epoch.
    Frames,
    /// No command outside an open epoch.
    Epoch,
    /// A motion ends when the robot reports standstill; no state is at rest before that.
    StandsFirst,
    /// Everything off in Idle and Complete.
    AllOff,
    /// No Idle without a self-test.
    SelfTest,
    // What is believed: `step`.
    /// An answer counts only for the act that it names.
    AnswersMatch,
    /// What is being changed is unknown.
    AskedIsUnknown,
    /// What leads to motion is refused while the robot is not ready.
    RobotReady,
    /// A robot that is not ready ends the work.
    ConditionAborts,
    /// An output or feedback that is contrary to what it proved voids that.
    ContraryDoubts,
    /// An emergency stop voids the localization, and what was known of arm and outputs.
    LossForgets,
    /// A motion is committed to the store before it begins.
    IntentFirst,
    /// Waypoints are executed in order.
    Sequence,
    /// A motion is done with its last waypoint.
    WholePath,
    /// An act that is not answered in time is a fault.
    AnswerDeadline,
    /// A stop that lasts too long is a fault.
    StopDeadline,
    /// Trouble ends the work.
    TroubleLeaves,
    /// An abort is sent to the robot.
    AbortIsSent,
    /// An epoch that the link has ended is not open.
    LinkEndsEpoch,
    /// A new program rests.
    BootRests,
    // What follows what: `execute`.
    /// A rejected result ends the cycle without contact.
    RejectEnds,
    /// A doubtful result waits for a person.
    ReviewHolds,
    /// A film without a result ends the cycle.
    InvalidEnds,
    /// An air-run makes no contact, and needs no water to determine where to go.
    AirRun,
    /// A dry picture before the first water.
    DryPicture,
    /// If the recipe's reference is a dry picture, a new one of the dried panel is taken after each abrasion.
    DryAfterAbrasion,
    /// Verify just before each contact.
    VerifyFirst,
    /// Nothing follows a contact path before what it did is graded.
    AssessFirst,
    /// A new localization does not replace the review of what a contact path did.
    ContactStays,
    /// Contact ends when the localization is too old.
    TokenInContact,
    /// A hold is left through Verify.
    UnholdVerifies,
    /// After a spray, no 3D shot before a person confirms that the panel is dry.
    DriedFirst,
    /// The limit for moves of the corner loop.
    MoveLimit,
    /// The limit for abrasions.
    PassLimit,
}

/// The rules in force: all of them, except in tests.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    without: Option<Rule>,
}

impl Rules {
    /// Every rule.
    pub const ALL: Rules = Rules { without: None };

    /// Whether this rule is in force.
    pub fn keep(self, rule: Rule) -> bool {
        self.without != Some(rule)
    }

    /// All but this one.
    #[cfg(test)]
    pub fn without(rule: Rule) -> Self {
        Rules { without: Some(rule) }
    }
}
