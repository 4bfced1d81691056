//! The simulated true state of the cell. It does not use the facts of the table, only its own outputs and its own arm.

use super::super::interlocks::Need;
use super::super::step::step_without;
use super::super::*;

/// Maximum number of waypoints that are sent and not yet executed.
pub const MAX_QUEUED_WAYPOINTS: u32 = 5;

/// A motion that the robot has not ended yet.
#[derive(Debug, Clone, Copy)]
pub struct Moving {
    pub id: Id,
    pub motion: Motion,
    pub sent: u32,
    pub done: u32,
}

/// The true state of the cell, together with the state of the table.
pub struct Cell {
    pub dropped: Option<Need>,
    pub state: State,
    pub robot: Robot,
    /// Whether the override has the value for which contact is planned; `None` before the first report.
    pub full_override: Option<bool>,
    pub arm: Option<Path>,
    pub moving: Option<Moving>,
    pub epoch: u32,
    pub epoch_open: bool,
    /// Whether an epoch was requested and may still open.
    pub opening: bool,
    pub frames: Option<Frames>,
    pub tool_on: bool,
    pub tool_proven: bool,
    pub water_on: bool,
    pub drained: bool,
    pub light_on: bool,
    pub light_settled: bool,
    pub lens_clear: bool,
    pub extraction_on: bool,
    pub extraction_proven: bool,
    /// Whether the link has ended the epoch because of the robot's next condition.
    pub condition_due: bool,
    /// Whether the robot ends its motion, by command or by its own watchdog.
    pub ending: bool,
    pub tested: bool,
    pub wet: bool,
    pub dry_picture: bool,
    /// Whether the tool was in contact with the panel since the last dry picture.
    pub sanded: bool,
    /// Whether the panel's pose was verified since the last plan, film or hold.
    pub verified: bool,
    /// Whether a person may have touched the panel since the last measurement of its pose.
    pub disturbed: bool,
    /// Whether the panel was located in this cycle, or a person has accepted its pose.
    pub located: bool,
    pub token: bool,
    /// Whether a result was rejected or invalid.
    pub doomed: bool,
    /// Whether a person must review a result.
    pub reviewed: bool,
    /// Whether the tool was in contact with the panel and the result is not graded yet.
    pub ungraded: bool,
    /// Whether a person must review the result of a contact path.
    pub contact_reviewed: bool,
    pub film: Option<Film>,
    pub passes: u8,
    /// Whether the cycle is an air-run, and (`flown`) whether its path was completely executed.
    pub air: bool,
    pub flown: bool,
    pub concluded: bool,
    pub intent: Option<Motion>,
    /// Actions whose answers would arrive too late.
    pub stale: Vec<(Id, Action)>,
    /// The active deadline of each kind.
    pub timers: Vec<(Deadline, Id)>,
    pub journal: Vec<Event>,
    pub effects: Vec<Effect>,
}

impl Cell {
    /// Creates a cell before its first event: outputs in the state in which a person left them.
    pub fn new(dropped: Option<Need>) -> Self {
        Cell {
            dropped,
            state: State::INITIAL,
            robot: Robot::Unknown,
            full_override: None,
            arm: None,
            moving: None,
            epoch: 3,
            epoch_open: false,
            opening: false,
            frames: None,
            tool_on: false,
            tool_proven: false,
            water_on: false,
            drained: false,
            light_on: true,
            light_settled: false,
            lens_clear: false,
            extraction_on: true,
            extraction_proven: false,
            condition_due: false,
            ending: false,
            tested: false,
            wet: true,
            dry_picture: false,
            sanded: false,
            verified: false,
            disturbed: true,
            located: false,
            token: false,
            doomed: false,
            reviewed: false,
            ungraded: false,
            contact_reviewed: false,
            film: None,
            passes: 0,
            air: false,
            flown: false,
            concluded: true,
            intent: None,
            stale: Vec::new(),
            timers: Vec::new(),
            journal: Vec::new(),
            effects: Vec::new(),
        }
    }

    /// Applies an event to the table, and performs the effects in the simulated cell.
    pub fn feed(&mut self, event: Event) -> Result<(), String> {
        let before = self.state;
        let due = before.due;
        self.apply_to_truth(event);
        let (state, effects) = step_without(self.dropped, before, event);
        self.journal.push(event);
        self.state = state;
        if let Some(due) = due.filter(|due| state.due.is_none_or(|now| now.id != due.id)) {
            self.stale.push((due.id, due.act));
        }
        self.update_truth(before, event);
        self.check_effects(before, event, &effects)?;
        self.check_state(before, event)?;
        self.effects = effects;
        Ok(())
    }

    /// Applies an event to the simulated cell, before the table receives it.
    fn apply_to_truth(&mut self, event: Event) {
        let Event::Reported(report) = event else { return };
        match report {
            Report::Answered { id, answer } => {
                if let Some(due) = self.state.due.filter(|due| due.id == id) {
                    self.answered(due.act, answer);
                }
            }
            Report::Deadline { id, which } => self.elapsed(id, which),
            Report::Contrary(switch) => self.reverse_switch(switch),
            Report::FullOverride(is_full) => self.full_override = Some(is_full),
            Report::Progress { .. } | Report::Trouble(_) | Report::OutputsOff => {}
            Report::StoreChanged | Report::StoreRestored => {}
            // The link has sent the abort frame, and the controller executes it.
            Report::EpochOver { trouble } => {
                self.condition_due |= trouble.is_none();
                (self.epoch_open, self.opening, self.frames, self.ending) = (false, false, None, true);
                self.switched_off();
            }
            Report::Robot(robot) => {
                self.robot = robot;
                if robot != Robot::Ready {
                    self.condition_due = false;
                    // A person who stopped the robot may jog the arm and operate every button.
                    (self.arm, self.token, self.verified, self.disturbed) = (None, false, false, true);
                    (self.light_on, self.light_settled) = (!self.light_on, false);
                    self.lens_clear = !self.lens_clear;
                    (self.extraction_proven, self.tool_proven) = (false, false);
                }
                if matches!(robot, Robot::Unknown | Robot::Restarted | Robot::LinkLost) {
                    self.full_override = None;
                }
                if matches!(robot, Robot::Restarted | Robot::LinkLost) {
                    (self.epoch_open, self.opening, self.frames, self.ending) = (false, false, None, true);
                    self.switched_off();
                }
                if robot == Robot::Restarted {
                    (self.moving, self.tool_on) = (None, false);
                }
            }
            Report::Boot => {
                (self.robot, self.full_override, self.condition_due) = (Robot::Unknown, None, false);
                (self.arm, self.token, self.verified, self.disturbed) = (None, false, false, true);
                // The session ends with the process, and the controller's watchdog switches everything off.
                (self.timers, self.ending) = (Vec::new(), true);
                (self.epoch_open, self.opening, self.frames) = (false, false, None);
                self.switched_off();
            }
        }
    }

    /// Sets the switch to its opposite state.
    fn reverse_switch(&mut self, switch: Switch) {
        match switch {
            Switch::ToolOn => (self.tool_on, self.tool_proven) = (false, false),
            Switch::ToolOff => self.tool_on = true,
            Switch::Rinse | Switch::Spray => self.water_on = false,
            Switch::WaterOff => (self.water_on, self.drained) = (true, false),
            Switch::LightOn => (self.light_on, self.light_settled) = (false, false),
            Switch::LightOff => self.light_on = true,
            Switch::LensClear => self.lens_clear = false,
            Switch::LensGuard => self.lens_clear = true,
            Switch::ExtractionOn => (self.extraction_on, self.extraction_proven) = (false, false),
            Switch::ExtractionOff => self.extraction_on = true,
        }
    }

    fn elapsed(&mut self, id: Id, which: Deadline) {
        let armed = self.timers.iter().position(|timer| *timer == (which, id));
        let Some(armed) = armed else { return };
        self.timers.remove(armed);
        match which {
            Deadline::Drain => self.drained = !self.water_on,
            Deadline::Settle => self.light_settled = self.light_on,
            Deadline::Token => self.token = false,
            _ => {}
        }
    }

    fn answered(&mut self, act: Action, answer: Answer) {
        match (act, answer) {
            (Action::Move(motion), Answer::Standstill { done }) => {
                self.touches(motion);
                self.moving = None;
                self.arm = (done == motion.waypoints).then_some(motion.path);
                self.flown |= self.arm == Some(Path::Air);
            }
            (Action::EndEpoch { .. }, Answer::Standstill { .. }) => {
                if let Some(moving) = self.moving.take() {
                    self.touches(moving.motion);
                    self.arm = None;
                }
                self.ending = false;
                self.switched_off();
            }
            (Action::CheckStandstill, Answer::Standstill { .. }) => self.moving = None,
            (Action::OpenEpoch { .. }, Answer::Epoch(epoch)) => {
                (self.epoch, self.epoch_open, self.opening) = (epoch, true, false);
                (self.frames, self.ending) = (None, false);
            }
            (Action::SetFrames(frames), Answer::Done) => self.frames = Some(frames),
            (Action::SelfTest, Answer::Done) => self.tested = true,
            (Action::Switch(Switch::ToolOff), Answer::Done) => self.tool_on = false,
            (Action::Switch(Switch::ToolOn), Answer::Done) => self.tool_proven = true,
            (Action::Switch(Switch::WaterOff), Answer::Done) => self.water_on = false,
            (Action::Switch(Switch::ExtractionOn), Answer::Done) => self.extraction_proven = true,
            (Action::DryPicture, Answer::Done) => (self.dry_picture, self.sanded) = (true, false),
            (Action::Locate | Action::Refine { .. }, Answer::Graded(Grade::Review)) => self.reviewed = true,
            (Action::Locate | Action::Refine { .. } | Action::Plan { .. }, Answer::Graded(Grade::Reject)) => {
                self.doomed = true
            }
            (Action::Locate, Answer::Graded(Grade::Accept)) => (self.located, self.disturbed) = (true, false),
            (Action::Refine { .. }, Answer::Graded(Grade::Accept)) => self.token = true,
            (Action::Verify { .. }, Answer::Graded(Grade::Accept)) => {
                (self.token, self.verified, self.disturbed) = (true, true, false);
            }
            (Action::Assess, Answer::Graded(grade)) => {
                self.ungraded = false;
                self.doomed |= grade == Grade::Reject;
                self.contact_reviewed |= grade == Grade::Review;
            }
            (Action::Plan { .. }, Answer::Planned { .. }) => self.verified = false,
            (Action::Plan { .. }, Answer::PlannedForReview { .. }) => {
                (self.verified, self.reviewed) = (false, true)
            }
            (Action::Film, Answer::Filmed(film)) => {
                self.film = Some(film);
                self.verified = false;
                self.doomed |= film == Film::Invalid;
                self.passes += u8::from(film == Film::Broken);
            }
            _ => {}
        }
    }

    fn touches(&mut self, motion: Motion) {
        let is_contact = motion.path == Path::Contact;
        self.ungraded |= is_contact;
        self.sanded |= is_contact;
    }

    /// Switches the outputs off at the end of an epoch; some of them switch off after an unknown time.
    fn switched_off(&mut self) {
        (self.tool_on, self.tool_proven, self.extraction_proven, self.light_settled) = (false, false, false, false);
        if std::mem::take(&mut self.water_on) {
            self.drained = false;
        }
    }

    /// Updates the true state after the decision of the table.
    fn update_truth(&mut self, before: State, event: Event) {
        match (event, self.state.at) {
            (Event::Asked(request @ (Request::Start { .. } | Request::AirRun { .. })), at)
                if before.at == At::Idle && at != At::Idle =>
            {
                (self.air, self.flown) = (matches!(request, Request::AirRun { .. }), false);
                // A new dry panel is in the fixture, at an unknown pose.
                (self.wet, self.dry_picture, self.verified, self.disturbed) = (false, false, false, true);
                (self.doomed, self.reviewed, self.film, self.passes, self.sanded) = (false, false, None, 0, false);
                (self.ungraded, self.contact_reviewed) = (false, false);
                (self.token, self.located, self.concluded) = (false, false, false);
            }
            (Event::Asked(Request::Reset), at) if at != before.at => self.tested = false,
            (Event::Asked(Request::Unhold { dried: true }), at) if at != before.at => {
                (self.wet, self.dry_picture, self.reviewed) = (false, false, false);
                self.located = false;
            }
            (Event::Asked(Request::Accept), at) if at != before.at => {
                (self.reviewed, self.disturbed, self.located) = (false, false, true);
                self.contact_reviewed = false;
            }
            _ => {}
        }
    }

    /// Sends the waypoints of a motion in an open epoch, as many as the window allows.
    pub fn send_waypoints(&mut self) -> Result<(), String> {
        let ending = self.ending;
        let (epoch, open) = (self.epoch, self.epoch_open);
        let Some(moving) = self.moving.as_mut().filter(|_| !ending) else { return Ok(()) };
        while moving.sent < moving.motion.waypoints && moving.sent - moving.done < MAX_QUEUED_WAYPOINTS {
            // I1
            if !open || moving.motion.epoch != epoch {
                return Err(format!("a waypoint of an ended epoch is sent: {moving:?}"));
            }
            moving.sent += 1;
        }
        Ok(())
    }
}
