//! Checks each effect when it is performed, and each state when it is entered, for forbidden situations.

use super::super::*;
use super::cell::{Cell, MAX_QUEUED_WAYPOINTS, Moving};
use panelprep_base::verdict::Verdict;

fn never(bad: bool, what: &str) -> Result<(), String> {
    if bad { Err(what.to_owned()) } else { Ok(()) }
}

impl Cell {
    /// Performs the effects in order, and checks each effect against the true state at that moment.
    pub fn check_effects(&mut self, before: State, event: Event, effects: &[Effect]) -> Result<(), String> {
        let changed = u64::from(self.state.at != before.at);
        never(self.state.step != before.step + changed, "a step that does not count the changes of the state")?;
        let mut last_id = before.last_id;
        let mut opened = None;
        for effect in effects {
            match *effect {
                Effect::Arm { id, deadline } => {
                    never(id <= last_id, "an id is used twice")?;
                    last_id = id;
                    self.timers.retain(|(which, _)| *which != deadline);
                    self.timers.push((deadline, id));
                }
                Effect::Do { id, act } => {
                    never(!self.timers.contains(&(Deadline::Answer, id)), "an act without a deadline")?;
                    never(self.state.due != Some(Due { id, act }), "an act that is not waited for")?;
                    never(event == Event::Reported(Report::Boot), "a new program acts unasked")?;
                    if let Action::Move(motion) = act {
                        // I9: a motion is committed to the store before it is sent.
                        never(opened != Some(motion), "a motion that is not committed before")?;
                    }
                    self.perform(id, act)?;
                }
                Effect::OpenIntent(motion) => {
                    never(self.intent.is_some(), "a motion is opened while one is open")?;
                    (opened, self.intent) = (Some(motion), Some(motion));
                }
                Effect::CloseIntent { motion, outcome, done } => {
                    never(self.moving.is_some(), "a motion is closed while the arm moves")?;
                    never(self.intent != Some(motion), "a motion is closed that was not open")?;
                    never(outcome == Outcome::Done && done != motion.waypoints, "a part of a path is called done")?;
                    self.intent = None;
                }
                Effect::Conclude { verdict } => {
                    never(self.concluded, "a cycle is concluded twice")?;
                    self.concluded = true;
                    let unfounded = match verdict {
                        // I7
                        Verdict::Pass if self.air => !self.flown,
                        Verdict::Pass => self.film != Some(Film::Whole),
                        Verdict::Fail => self.film != Some(Film::Broken),
                        Verdict::Invalid => self.film != Some(Film::Invalid),
                        _ => false,
                    };
                    never(unfounded, "a verdict without its film")?;
                    let is_result = matches!(verdict, Verdict::Pass | Verdict::Fail);
                    never(is_result && self.ungraded, "a result though it is not known what the contact did")?;
                }
                Effect::Refuse { request, .. } => {
                    let untouched = self.state.at == before.at || request == Request::Reset;
                    never(!untouched, "a refused request changes the state")?;
                }
            }
        }
        Ok(())
    }

    fn perform(&mut self, id: Id, act: Action) -> Result<(), String> {
        let parked = self.arm == Some(Path::Park) && self.moving.is_none();
        match act {
            Action::CheckStandstill | Action::SelfTest => {}
            Action::Assess => never(!self.ungraded, "a grade of no contact")?,
            Action::OpenEpoch { .. } => self.opening = true,
            Action::EndEpoch { .. } => {
                (self.epoch_open, self.opening, self.frames, self.ending) = (false, false, None, true);
            }
            Action::SetFrames(_) => never(!self.epoch_open, "frames outside an epoch")?,
            Action::Switch(switch) => self.switch(switch)?,
            Action::Move(motion) => self.check_move(id, motion)?,
            Action::Locate | Action::DryPicture | Action::Film => {
                never(!parked, "a shot with the arm in view")?;
                never(self.water_on, "a shot while water runs")?;
                never(!self.lens_clear, "a shot through a guarded lens")?;
                let dark = act == Action::Locate;
                never(dark && self.light_on, "a 3D shot with the light on")?;
                never(!dark && !self.light_settled, "a picture without steady light")?;
                never(act != Action::Film && self.wet, "a dry shot of a wet panel")?;
                never(
                    act == Action::Film && !(self.wet && self.dry_picture),
                    "a film without water or dry picture",
                )?;
                let is_old = self.state.job.dries && self.sanded;
                never(act == Action::Film && is_old, "a film held against a dry picture from before the abrasion")?;
                never(act != Action::Locate && self.disturbed, "a picture of a panel whose place is not known")?;
            }
            Action::Refine { view } | Action::Verify { view } => self.check_corner(view)?,
            Action::Plan { pass } => {
                never(self.film != Some(Film::Broken) && !self.air, "a plan without a break")?;
                never(self.disturbed, "a plan on a panel whose place is not known")?;
                never(pass != self.passes || pass > self.state.job.max_passes, "a pass too many")?;
            }
        }
        let goes_on = !matches!(
            act,
            Action::EndEpoch { .. } | Action::Switch(_) | Action::OpenEpoch { .. } | Action::CheckStandstill
        );
        let parks = matches!(act, Action::Move(Motion { path: Path::Park, .. }));
        never(self.doomed && !parks && self.state.job.running && goes_on, "work after a reject")?;
        let waits = self.reviewed || self.contact_reviewed;
        never(waits && self.state.job.running && goes_on, "work on a result that waits for a person")?;
        let works = match act {
            Action::Plan { .. } | Action::Film | Action::Switch(Switch::Rinse | Switch::Spray | Switch::ToolOn) => {
                true
            }
            Action::Move(motion) => matches!(motion.path, Path::Approach | Path::Contact),
            _ => false,
        };
        never(self.ungraded && works, "work on a panel though it is not known what the contact did")
    }

    fn check_corner(&self, view: u8) -> Result<(), String> {
        never(self.arm != Some(Path::Corner { view }), "a corner picture from elsewhere")?;
        never(self.light_on, "a corner picture with the light on")?;
        never(!self.lens_clear, "a corner picture through a guarded lens")?;
        never(view > self.state.job.max_moves, "a move of the corner loop too many")
    }

    fn check_move(&mut self, id: Id, motion: Motion) -> Result<(), String> {
        // I2
        never(self.robot != Robot::Ready, "motion while the robot is not ready")?;
        let may =
            matches!(self.state.at, At::Starting | At::Execute(_) | At::Unholding { .. } | At::Completing { .. });
        never(!may, "motion in a state that does not move")?;
        never(self.moving.is_some(), "a motion before the last one stood")?;
        // I1
        never(!self.epoch_open || motion.epoch != self.epoch, "motion in an ended epoch")?;
        never(motion.waypoints == 0, "a path without waypoints")?;
        never(motion.path != Path::Park && !self.located, "a move toward a panel that was not found")?;
        never(self.water_on, "motion while water runs")?;
        never(motion.path != Path::Contact && self.tool_on, "motion in air with the tool on")?;
        let frames = match motion.path {
            Path::Park => self.frames,
            Path::Corner { .. } => Some(Frames::Camera),
            Path::Approach | Path::Contact | Path::Air | Path::Retract => Some(Frames::Pad),
        };
        never(self.frames != frames, "motion in the wrong base and tool")?;
        if matches!(motion.path, Path::Approach | Path::Contact | Path::Air) {
            // I3, I10
            never(!self.token, "contact without a live localization")?;
            never(!self.verified || self.disturbed, "contact without Verify")?;
            never(!self.drained, "contact before the cell drained")?;
            never(self.doomed, "contact after a reject")?;
        }
        if motion.path == Path::Air {
            never(!self.air, "a path in air where the panel is to be abraded")?;
            never(self.arm != Some(Path::Approach), "a path in air that does not begin at the approach point")?;
        }
        if motion.path == Path::Contact {
            never(self.air, "contact in an air-run")?;
            never(self.full_override != Some(true), "contact at another override than it is planned for")?;
            never(self.arm != Some(Path::Approach), "contact that does not begin in air")?;
            never(!self.tool_on || !self.tool_proven, "contact with a dead tool")?;
            never(!self.extraction_on || !self.extraction_proven, "contact without extraction")?;
        }
        self.arm = None;
        self.moving = Some(Moving { id, motion, sent: 0, done: 0 });
        self.send_waypoints()
    }

    /// Sets a switch. An output changes when it is commanded, but is treated as off only when its feedback has
    /// confirmed it.
    fn switch(&mut self, switch: Switch) -> Result<(), String> {
        never(!self.epoch_open, "an output outside an epoch")?;
        let wets_or_rubs = matches!(switch, Switch::Rinse | Switch::Spray | Switch::ToolOn);
        never(self.air && !self.concluded && wets_or_rubs, "water or tool in an air-run")?;
        match switch {
            Switch::Rinse | Switch::Spray => {
                never(self.arm != Some(Path::Park) || self.moving.is_some(), "water on an arm that is not parked")?;
                never(self.tool_on, "water on a running tool")?;
                never(self.lens_clear, "water on an open lens")?;
                never(!self.dry_picture, "water before the dry picture")?;
                never(self.disturbed, "water on a panel whose place is not known")?;
                (self.water_on, self.drained, self.wet) = (true, false, true);
            }
            Switch::ToolOn => {
                never(self.full_override != Some(true), "the tool starts at another override than contact needs")?;
                never(self.water_on || !self.drained, "the tool starts before the cell drained")?;
                never(!self.extraction_on || !self.extraction_proven, "the tool starts without extraction")?;
                never(self.arm != Some(Path::Approach), "the tool starts elsewhere than at the approach point")?;
                (self.tool_on, self.tool_proven) = (true, false);
            }
            Switch::LightOn => (self.light_on, self.light_settled) = (true, false),
            Switch::LightOff => (self.light_on, self.light_settled) = (false, false),
            Switch::LensClear => self.lens_clear = true,
            Switch::LensGuard => self.lens_clear = false,
            Switch::ExtractionOn => (self.extraction_on, self.extraction_proven) = (true, false),
            Switch::ExtractionOff => (self.extraction_on, self.extraction_proven) = (false, false),
            Switch::ToolOff | Switch::WaterOff => {}
        }
        Ok(())
    }

    /// Checks that the state after an event is allowed.
    pub fn check_state(&mut self, before: State, event: Event) -> Result<(), String> {
        let (at, from) = (self.state.at, before.at);
        let leaves = matches!(at, At::Aborting { .. } | At::Aborted { .. } | At::Stopped | At::Held(_));
        never(self.robot != Robot::Ready && !leaves, "the robot is not ready and the work continues")?;
        let trusted = self.state.facts.token.is_some() || self.state.facts.arm.is_some();
        never(self.robot == Robot::EmergencyStop && trusted, "trust after an emergency stop")?;
        never(
            self.moving.is_some_and(|moving| moving.sent - moving.done > MAX_QUEUED_WAYPOINTS),
            "more than the window",
        )?; // I4
        // I5
        let watched = |moving: Moving| self.timers.contains(&(Deadline::Answer, moving.id)) || self.ending;
        never(self.moving.is_some_and(|moving| !watched(moving)), "motion that is not watched")?;
        let leaving = matches!(at, At::Holding(_) | At::Stopping { .. } | At::Aborting { .. });
        never(leaving && self.moving.is_some() && !self.ending, "the abort frame waits for something")?;
        let moves = self.moving.is_some() || self.state.intent.is_some();
        never(at.is_at_rest() && self.state.facts.token.is_some(), "a localization that outlives its work")?;
        if at.is_at_rest() && at != from {
            never(moves && !matches!(at, At::Aborted { .. }), "rest before the robot stands")?;
            never(self.moving.is_some() && !self.ending, "rest without an abort frame")?;
            never(self.moving.is_some() && self.state.intent.is_none(), "a motion without an intent")?;
            let stopped = matches!(from, At::Stopping { .. }) || event == Event::Asked(Request::Stop);
            let left = matches!(at, At::Held(_)) || (at == At::Stopped && stopped);
            never(left && (self.epoch_open || self.opening), "rest in an open epoch")?;
            let shut = matches!(at, At::Held(_) | At::Idle | At::Complete { .. });
            never(shut && (self.water_on || self.tool_on), "rest with water or tool on")?;
        }
        match at {
            At::Held(_) if at != from => (self.verified, self.token, self.disturbed) = (false, false, true),
            At::Idle if at != from => {
                never(!self.tested, "Idle without a self-test")?;
                never(self.light_on || self.extraction_on, "Idle with light or extraction on")?;
            }
            At::Complete { .. } if at != from => {
                never(self.arm != Some(Path::Park), "Complete with the arm out")?;
                never(self.light_on || self.extraction_on, "Complete with light or extraction on")?;
                never(!self.concluded, "Complete without a result")?;
            }
            _ => {}
        }
        self.check_reaction(before, event)
    }

    /// Checks that an event leads to the required reaction.
    fn check_reaction(&self, before: State, event: Event) -> Result<(), String> {
        let (at, from, due) = (self.state.at, before.at, before.due);
        let is_due = |id| due.is_some_and(|due| due.id == id);
        let aborts = matches!(at, At::Aborting { .. } | At::Aborted { .. });
        let Event::Reported(report) = event else { return Ok(()) };
        match report {
            Report::Boot => never(!matches!(at, At::Stopped | At::Aborted { .. }), "a new program does not rest"),
            Report::Deadline { id, which: Deadline::Answer } if is_due(id) => {
                never(self.state.due == due, "an act may take for ever")
            }
            Report::Deadline { id, which: Deadline::Stop } if from == (At::Stopping { until: id }) => {
                never(!aborts, "a stop may take for ever")
            }
            Report::Deadline { id, which: Deadline::Token } if before.facts.token == Some(id) => {
                let contact = before.intent.is_some_and(|intent| intent.motion.path == Path::Contact);
                never(contact && matches!(at, At::Execute(_)), "contact with an old localization")
            }
            Report::Progress { id, done } if is_due(id) => {
                let reported = before.intent.map_or(0, |intent| intent.done);
                let in_order =
                    before.intent.is_some_and(|intent| done <= intent.motion.waypoints) && reported <= done;
                let moves = due.is_some_and(|due| matches!(due.act, Action::Move(_)));
                never(moves && !in_order && !aborts, "acknowledgements out of order are believed")
            }
            Report::Answered { id, answer: Answer::Standstill { done } } if is_due(id) => {
                let short = matches!(due, Some(Due { act: Action::Move(motion), .. }) if motion.waypoints != done);
                never(short && !aborts, "a part of a path is taken for the whole")
            }
            Report::Answered { id, answer: Answer::Epoch(epoch) } if is_due(id) => {
                never(epoch <= before.epoch && self.state.facts.epoch == Epoch::Open, "an old epoch is taken")
            }
            Report::StoreChanged | Report::StoreRestored => {
                never(!aborts, "work continues by a store that was changed")
            }
            Report::FullOverride(false) if from == At::Execute(Phase::Abrade) && !self.air => {
                never(at == from, "contact continues at another override")
            }
            Report::Contrary(_) if from.is_at_rest() => {
                never(at != from, "a contrary output at rest changes the state")
            }
            Report::Contrary(_) if matches!(from, At::Execute(_)) => {
                never(matches!(at, At::Execute(_)), "work continues by what is not so any more")
            }
            Report::Trouble(_) if from.is_at_rest() => never(at != from, "trouble at rest changes the state"),
            Report::Trouble(Trouble::Store) => never(!aborts && at != At::Stopped, "motion without a journal"),
            _ => Ok(()),
        }
    }
}
