//! Texts for the people at the cell about states, refusals and causes: the situation, and what to do.

use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{
    At, Cause, Epoch, Event, Hold, Refusal, Report, Request, Robot, State, Trouble, Why, step,
};

/// Returns the word of `panelprep ctl` for this request.
pub fn request_keyword(request: Request) -> &'static str {
    match request {
        Request::Reset => "reset",
        Request::Start { .. } => "start",
        Request::AirRun { .. } => "air-run",
        Request::Hold => "hold",
        Request::Unhold { .. } => "unhold",
        Request::Accept => "accept",
        Request::Stop => "stop",
        Request::Abort => "abort",
        Request::Clear => "clear",
    }
}

/// Returns the complete command of `panelprep ctl` for this request.
pub fn command(request: Request) -> &'static str {
    match request {
        Request::Unhold { dried: true } => "unhold --dried",
        other => request_keyword(other),
    }
}

/// Returns the reason to refuse a decision that does not contain the number of the step to which it refers.
pub(super) fn missing_step_reason(request: Request) -> Reason {
    let message = format!(
        "{} does not contain the number of the step to which it refers; read the state, then repeat the request with \
         the step number from the state",
        command(request)
    );
    Reason::new("bad_request", message)
}

/// Returns the reason why a decision on an earlier step is not accepted now. `was` is the description of that step as
/// it was shown, if it is known.
pub(super) fn outdated_step_reason(request: Request, (step, was): (u64, Option<&str>), now: &State) -> Reason {
    let was = was.unwrap_or("a state that this service does not know");
    let message = format!(
        "{} refers to step {step} ({was}), but the cell is now at step {} ({}); read the state and decide again",
        command(request),
        now.step,
        describe_step(now)
    );
    Reason::new("outdated", message)
}

/// Describes a step: the state, its phase, and the reason for the state.
pub(super) fn describe_step(state: &State) -> String {
    let phase = match state.at {
        At::Held(hold) | At::Holding(hold) => format!(", {}", hold.resume.keyword()),
        _ => String::new(),
    };
    let why = state_reason(state).into_iter().next().map_or(String::new(), |reason| format!(" ({})", reason.code));
    format!("{}{phase}{why}", describe_place(state.at))
}

/// Describes the state with its phase, such as `execute, refine`.
pub(super) fn describe_place(at: At) -> String {
    match at {
        At::Execute(inside) => format!("{}, {}", at.keyword(), inside.keyword()),
        _ => at.keyword().to_owned(),
    }
}

/// Returns the words of the requests that the state table would accept now. The buttons of the page, the nodes of the
/// plant and the text of a refusal use this list.
pub(super) fn possible_requests(state: &State) -> Vec<&'static str> {
    let all = [
        Request::Reset,
        Request::Start { max_passes: 1, max_moves: 0, dries: false },
        Request::AirRun { max_moves: 0 },
        Request::Hold,
        Request::Unhold { dried: false },
        Request::Unhold { dried: true },
        Request::Accept,
        Request::Stop,
        Request::Abort,
        Request::Clear,
    ];
    let taken = |request: &Request| {
        let (_, effects) = step(*state, Event::Asked(*request));
        !effects.iter().any(|effect| matches!(effect, panelprep_cell::cycle::Effect::Refuse { .. }))
    };
    all.into_iter().filter(taken).map(command).collect()
}

/// Returns the reason why a request is refused in this state.
pub fn refusal(request: Request, refusal: Refusal, state: &State) -> Reason {
    let word = request_keyword(request);
    let possible = || match possible_requests(state) {
        words if words.is_empty() => "no command is possible in this state".to_owned(),
        words => format!("possible now: {}", words.join(", ")),
    };
    match refusal {
        Refusal::NotNow => {
            let message = format!("{word} is not possible in state {}; {}", describe_place(state.at), possible());
            Reason::new("not_now", message)
        }
        Refusal::Robot(condition) => {
            let robot = robot_reason(condition);
            Reason { message: format!("{word} needs a robot that is ready: {}", robot.message), ..robot }
        }
        Refusal::Review if matches!(state.at, At::Held(hold) if hold.is_for_contact()) => {
            let message = "held for review of the tool's work: read the finding, then accept the result or stop the \
                           cycle. Drying the panel does not undo the sanding";
            Reason::new("review", message)
        }
        Refusal::Review => {
            let message = "held for review: check the result, then accept it; or dry the panel and locate it again \
                           with `unhold --dried`";
            Reason::new("review", message)
        }
        Refusal::Undried => {
            let message = "held until the panel is dry: dry the panel, then run `unhold --dried`; the cycle then \
                           locates the panel and captures a new dry picture";
            Reason::new("drying", message)
        }
        Refusal::Failed(what) => {
            let failed = trouble_reason(what);
            Reason { message: format!("{word} failed: {}", failed.message), ..failed }
        }
    }
}

/// Returns the reason that describes the condition of the robot, for example why it is not ready.
pub(super) fn robot_reason(robot: Robot) -> Reason {
    let (code, message) = match robot {
        Robot::Unknown => (
            "robot_unknown",
            "no message was received from the robot controller yet; check its cable, \
                                             address and program",
        ),
        Robot::Ready => ("robot_ready", "the robot is ready"),
        Robot::LinkLost => {
            ("link_lost", "no connection to the robot controller; check its cable, address and program")
        }
        Robot::Restarted => (
            "robot_restarted",
            "the robot controller or its program was restarted; wait until it is \
                                                 ready",
        ),
        Robot::EmergencyStop => {
            ("emergency_stop", "an emergency stop is pressed; with the drives off the arm does not retract")
        }
        Robot::GuardOpen => ("guard_open", "the guard is open"),
        Robot::DrivesOff => ("drives_off", "the robot's drives are off, or no motion is possible"),
        Robot::NotAutomatic => ("not_automatic", "the robot is in T1 or T2; switch it to automatic"),
        Robot::OtherPrograms => (
            "other_programs",
            "the robot's programs or cell_config.dat differ from those with which the cell was accepted: their \
             checksum is not [robot] programs_sum. Compare the files with `panelprep doctor --kuka DIR`",
        ),
    };
    Reason::new(code, message)
}

pub(super) fn trouble_reason(trouble: Trouble) -> Reason {
    let (code, message) = match trouble {
        Trouble::Camera => ("camera", "a camera delivered no picture; check its cable and power"),
        Trouble::Picture => ("picture", "the pictures of a camera cannot be used; read the finding for the reason"),
        Trouble::Computing => ("computing", "a computation failed"),
        Trouble::Feedback => {
            ("feedback", "a feedback differs from its expected state: tool, extraction, water, lens or light")
        }
        Trouble::Force => (
            "force",
            "compliant tool fault; the arm keeps the tool off the panel. Read the finding of this fault, then run \
             `panelprep doctor`",
        ),
        Trouble::Starved => {
            ("starved", "the robot stopped on its path, because further waypoints arrived too late")
        }
        Trouble::Override => (
            "override",
            "contact requires an override of 100 %, but the controller's override is different or was changed",
        ),
        Trouble::Slow => {
            ("slow", "the robot is far behind its planned motion; check its override and its messages")
        }
        Trouble::Gate => ("gate", "a path failed a check and was not sent; read the finding for the reason"),
        Trouble::Refused => ("refused", "the robot refused a command, or the command could not be sent"),
        Trouble::Short => ("short", "the robot stopped before the end of its path"),
        Trouble::Sequence => ("sequence", "the robot acknowledged commands out of order"),
        Trouble::Protocol => ("protocol", "the controller sent a message that violates the protocol"),
        Trouble::Deviation => ("deviation", "the arm is not at its commanded position"),
        Trouble::Store => ("store", "the store cannot be written, or its disk is full"),
        Trouble::DiskFull => ("disk_full", "the store's disk is full; `panelprep ctl state` lists what to delete"),
        Trouble::Late => ("late", "a device did not respond before its deadline; read the finding for the device"),
        Trouble::Unexpected => ("unexpected", "a device sent a response that does not match the request"),
    };
    Reason::new(code, message)
}

/// Returns the reason for a cycle that was ended on request: this is not a fault, and no Clear is needed.
pub(super) fn stopped_reason() -> Reason {
    Reason::new("stopped", "stopped on request before the cycle's end")
}

/// Returns the reason why this event ended an incomplete cycle. `at` is the state after the event.
pub(super) fn end_reason(event: Event, at: At) -> Option<Reason> {
    match (event, at) {
        (Event::Reported(Report::Boot), _) => {
            Some(Reason::new("interrupted", "the program ended before the end of the cycle"))
        }
        (_, At::Aborting { cause } | At::Aborted { cause }) => Some(cause_reason(cause)),
        (_, At::Stopping { .. } | At::Stopped) => Some(stopped_reason()),
        _ => None,
    }
}

/// Returns the reasons why the cycle is in this state, unless this is obvious, with the remedy, and with the devices
/// that may still run or move.
pub fn state_reason(state: &State) -> Vec<Reason> {
    let why = match state.at {
        At::Aborting { cause } | At::Aborted { cause } | At::Clearing { cause } => Some(abort_reason(cause)),
        At::Held(hold) | At::Holding(hold) => Some(hold_reason(hold)),
        _ => None,
    };
    why.into_iter().chain(unproven_commands(state)).collect()
}

/// Returns one reason for each command that was sent before the robot came to rest here, and that the robot has not
/// confirmed.
fn unproven_commands(state: &State) -> Vec<Reason> {
    let At::Aborted { .. } = state.at else { return vec![] };
    let mut reasons = Vec::new();
    if state.facts.water_may_run {
        let message = "water may be running: the water was switched on, and no feedback confirms that it is off; \
                       close the valve by hand if water runs";
        reasons.push(Reason::new("water_may_run", message));
    }
    if state.facts.tool_may_run {
        let message = "the sanding tool may be running: the tool was switched on, and no feedback confirms that it \
                       is off; do not reach for the tool before it is at rest";
        reasons.push(Reason::new("tool_may_run", message));
    }
    if state.intent.is_some() || state.facts.epoch == Epoch::Changing {
        let message = "the robot has not confirmed its standstill; the controller stops the arm by its own rules. \
                       If the arm moves, press the emergency stop";
        reasons.push(Reason::new("stop_not_confirmed", message));
    }
    reasons
}

fn cause_reason(cause: Cause) -> Reason {
    match cause {
        Cause::Asked => Reason::new("asked", "an abort was requested"),
        Cause::Robot(condition) => robot_reason(condition),
        Cause::Trouble(what) => trouble_reason(what),
        Cause::StopTimedOut => Reason::new("stop_timed_out", "the stop took longer than [limits] stop_deadline_s"),
        Cause::Interrupted => Reason::new(
            "interrupted",
            "the program ended before a motion was reported as \
                                                          finished",
        ),
        Cause::StoreChanged => {
            let message = "the store was changed by another program, and the last actions of the cell may be \
                           unknown; run `panelprep store verify` to list the differences";
            Reason::new("store_changed", message)
        }
        Cause::StoreRestored => {
            let message = "the store was restored from a backup and does not contain the work of the cell after that \
                           backup. A part that was in the cell may have been sanded more often than recorded; take \
                           such parts out, or let an inspector decide";
            Reason::new("store_restored", message)
        }
        Cause::OutputsOn => Reason::new("outputs_on", "the program ended while the tool or the water was on"),
    }
}

fn abort_reason(cause: Cause) -> Reason {
    let because = cause_reason(cause);
    let message = format!(
        "aborted: {}; look at the cell, jog the pad off the panel if the pad touches it, then run `panelprep ctl \
         clear`",
        because.message
    );
    Reason { message, ..because }
}

fn hold_reason(hold: Hold) -> Reason {
    let next = "continue with `panelprep ctl unhold`";
    match hold.why {
        Why::Asked => Reason::new("asked", format!("held on request of a person; {next}")),
        Why::Review if hold.is_for_contact() => Reason::new(
            "review",
            "held for review of the tool's work: read the finding, then run `panelprep ctl accept` or `panelprep \
             ctl stop`",
        ),
        Why::Review => Reason::new(
            "review",
            "held for review: check the result, then run `panelprep ctl accept`, or dry the panel and run \
             `panelprep ctl unhold --dried`",
        ),
        Why::NotVerified => Reason::new(
            "not_verified",
            "held: the panel is not at its located pose; dry the panel, then locate it again with `panelprep ctl \
             unhold --dried`",
        ),
        Why::Drying => Reason::new(
            "drying",
            "held: the recipe requires a new dry picture after sanding; dry the panel, then capture the picture with \
             `panelprep ctl unhold --dried`",
        ),
        Why::TokenOver => {
            Reason::new("token_over", format!("held: the localization became too old during contact; {next}"))
        }
        Why::Trouble(what) => {
            let mended = trouble_reason(what);
            Reason { message: format!("held: {}. Fix the cause, then {next}", mended.message), ..mended }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cycle::Phase;

    fn ready() -> State {
        step(State::INITIAL, Event::Reported(Report::Robot(Robot::Ready))).0
    }

    #[test]
    fn a_refusal_states_what_is_possible() {
        let words = refusal(Request::Hold, Refusal::NotNow, &ready());
        assert_eq!(words.message, "hold is not possible in state stopped; possible now: reset, abort");
        let words = refusal(Request::Reset, Refusal::Robot(Robot::GuardOpen), &State::INITIAL);
        assert_eq!(
            (&*words.code, &*words.message),
            ("guard_open", "reset needs a robot that is ready: the guard is open")
        );
    }

    /// "Dry the panel" is not offered if the result of the tool's work waits for a person's review.
    #[test]
    fn a_review_of_contact_offers_accept_and_stop_alone() {
        let at = |resume| At::Held(Hold { why: Why::Review, resume });
        let mut state = State { at: at(Phase::Assess { left: false }), ..ready() };
        for words in [&state_reason(&state)[0], &refusal(Request::Unhold { dried: true }, Refusal::Review, &state)]
        {
            assert!(
                words.code == "review" && words.message.contains("review of the tool's work"),
                "{}",
                words.message
            );
            assert!(!words.message.contains("--dried"), "{}", words.message);
        }
        assert_eq!(possible_requests(&state), ["accept", "stop", "abort"]);
        state.at = at(Phase::Plan);
        assert!(
            state_reason(&state)[0].message.contains("--dried")
                && possible_requests(&state).contains(&"unhold --dried")
        );
    }

    #[test]
    fn an_abort_names_its_cause_and_the_way_out() {
        let state = State { at: At::Aborted { cause: Cause::Interrupted }, ..State::INITIAL };
        let [reason] = &state_reason(&state)[..] else { panic!("{:?}", state_reason(&state)) };
        assert_eq!(reason.code, "interrupted");
        assert!(
            reason.message.contains("before a motion was reported as finished")
                && reason.message.contains("ctl clear")
        );
        assert_eq!(state_reason(&State { at: At::Idle, ..State::INITIAL }), []);
    }

    /// Unconfirmed commands are reported in addition to the cause, until a feedback or a person confirms the state.
    #[test]
    fn what_is_not_proven_is_reported() {
        let mut state = State { at: At::Aborted { cause: Cause::OutputsOn }, ..State::INITIAL };
        (state.facts.water_may_run, state.facts.epoch) = (true, Epoch::Changing);
        let told = state_reason(&state);
        let codes: Vec<&str> = told.iter().map(|reason| &*reason.code).collect();
        assert_eq!(codes, ["outputs_on", "water_may_run", "stop_not_confirmed"]);
        assert!(told[1].message.starts_with("water may be running"), "{}", told[1].message);
        state = step(state, Event::Reported(Report::OutputsOff)).0;
        assert_eq!(state_reason(&state).len(), 2);
    }
}
