//! Generates events: the next event of a cell without faults and its operator, and random unexpected events. Also
//! functions for scenarios with a cell without faults.

use super::super::*;
use super::cell::Cell;
use rand::RngExt;
use rand_pcg::Pcg64;

fn one_of<T: Copy>(random: &mut Pcg64, all: &[T]) -> T {
    all[random.random_range(0..all.len())]
}

impl Cell {
    /// Returns the next event if there is no fault; `None` is a dead end.
    pub fn next_healthy_event(&mut self, random: &mut Pcg64) -> Option<Event> {
        if self.condition_due {
            return Some(Event::Reported(Report::Robot(Robot::GuardOpen)));
        }
        if let Some(due) = self.state.due {
            return Some(Event::Reported(self.answer(due, random)));
        }
        let waits = [Deadline::Rinse, Deadline::Spray, Deadline::Settle, Deadline::Drain];
        let timer = waits.iter().find_map(|wait| self.timers.iter().find(|(which, _)| which == wait));
        match timer {
            // The drain time may continue while no state waits for it.
            Some(&(which, id)) if !self.state.at.is_at_rest() || random.random_bool(0.5) => {
                Some(Event::Reported(Report::Deadline { id, which }))
            }
            _ if !self.state.at.is_at_rest() => None,
            _ if self.robot != Robot::Ready => Some(Event::Reported(Report::Robot(Robot::Ready))),
            _ if self.full_override != Some(true) => Some(Event::Reported(Report::FullOverride(true))),
            _ => Some(Event::Asked(self.request(random))),
        }
    }

    /// Returns the next event if a person clears, resets and starts, and there are no further faults.
    pub fn next_recovery_event(&mut self, random: &mut Pcg64) -> Option<Event> {
        if self.robot != Robot::Ready && !self.condition_due {
            return Some(Event::Reported(Report::Robot(Robot::Ready)));
        }
        Some(match self.state.at {
            at if !at.is_at_rest() || self.condition_due => return self.next_healthy_event(random),
            At::Idle => Event::Asked(Request::Start { max_passes: 1, max_moves: 1, dries: false }),
            At::Aborted { .. } => Event::Asked(Request::Clear),
            At::Held(_) => Event::Asked(Request::Stop),
            _ => Event::Asked(Request::Reset),
        })
    }

    fn request(&self, random: &mut Pcg64) -> Request {
        match self.state.at {
            At::Idle if random.random_bool(0.15) => Request::AirRun { max_moves: random.random_range(0..5) },
            At::Idle => Request::Start {
                max_passes: random.random_range(0..4),
                max_moves: random.random_range(0..5),
                dries: random.random(),
            },
            At::Held(Hold { why: Why::Review, .. }) if random.random_bool(0.8) => Request::Accept,
            At::Held(Hold { why: Why::NotVerified, .. }) => Request::Unhold { dried: random.random_bool(0.7) },
            At::Held(_) => Request::Unhold { dried: random.random_bool(0.2) },
            At::Aborted { .. } => Request::Clear,
            _ => Request::Reset,
        }
    }

    fn answer(&mut self, due: Due, random: &mut Pcg64) -> Report {
        if let (Action::Move(_), Some(moving)) = (due.act, self.moving.as_mut())
            && moving.done < moving.motion.waypoints
        {
            moving.done += random.random_range(1..=moving.sent - moving.done);
            return Report::Progress { id: moving.id, done: moving.done };
        }
        let grade = |random: &mut Pcg64, good: f64| match random.random_bool(good) {
            true => Grade::Accept,
            false => one_of(random, &[Grade::Review, Grade::Reject]),
        };
        let done = self.moving.map_or(0, |moving| moving.done);
        let answer = match due.act {
            Action::CheckStandstill | Action::EndEpoch { .. } => Answer::Standstill { done },
            Action::Move(motion) => Answer::Standstill { done: motion.waypoints },
            Action::OpenEpoch { above } => Answer::Epoch(above.max(self.epoch) + 1),
            Action::SelfTest | Action::SetFrames(_) | Action::Switch(_) | Action::DryPicture => Answer::Done,
            Action::Locate | Action::Assess => Answer::Graded(grade(random, 0.9)),
            Action::Refine { view } if random.random_bool(1.0 / f64::from(view + 2)) => Answer::LookOn,
            Action::Refine { .. } => Answer::Graded(grade(random, 0.95)),
            Action::Verify { view } if random.random_bool(0.5 / f64::from(view + 1)) => Answer::LookOn,
            Action::Verify { .. } => Answer::Graded(grade(random, 0.93)),
            Action::Film if random.random_bool(0.03) => Answer::Filmed(Film::Invalid),
            Action::Film => Answer::Filmed(if random.random_bool(0.7) { Film::Broken } else { Film::Whole }),
            Action::Plan { .. } if random.random_bool(0.03) => Answer::Graded(Grade::Reject),
            Action::Plan { .. } if random.random_bool(0.05) => Answer::Planned { plan: 0, waypoints: 0 },
            Action::Plan { .. } => {
                let (plan, waypoints) = (random.random(), random.random_range(1..30));
                match random.random_bool(0.1) {
                    true => Answer::PlannedForReview { plan, waypoints },
                    false => Answer::Planned { plan, waypoints },
                }
            }
        };
        Report::Answered { id: due.id, answer }
    }

    /// Returns a random event that may occur in any state.
    pub fn unexpected_event(&mut self, random: &mut Pcg64) -> Event {
        let due = self.state.due;
        let reported = match random.random_range(0..23) {
            20 => {
                let trouble = random.random_bool(0.8).then(|| one_of(random, &TROUBLES));
                Report::EpochOver { trouble }
            }
            0..=2 => return Event::Asked(one_of(random, &REQUESTS)),
            3 => return Event::Asked(Request::Hold),
            4 => return Event::Asked(one_of(random, &[Request::Stop, Request::Abort])),
            5..=8 if !self.timers.is_empty() => {
                let (which, id) = one_of(random, &self.timers);
                Report::Deadline { id, which }
            }
            // A late report of an action that was cancelled or is already answered. It often matches the type of the
            // action in progress.
            9..=13 if !self.stale.is_empty() => {
                let recent = self.stale.len() - random.random_range(1..=self.stale.len().min(3));
                let (id, act) = self.stale[recent];
                let act = due.map_or(act, |due| due.act);
                one_of(random, &answers(act, id))
            }
            14 if due.is_some() => one_of(random, &due.map_or_else(Vec::new, |due| answers(due.act, due.id))),
            15 if due.is_some() => {
                let id = due.map_or(Id(0), |due| due.id);
                Report::Progress { id, done: random.random_range(0..40) }
            }
            16 => Report::Trouble(one_of(random, &TROUBLES)),
            17 => Report::Boot,
            22 => Report::FullOverride(random.random_bool(0.4)),
            18 => Report::Robot(one_of(random, &ROBOTS)),
            21 => {
                let proven: Vec<Switch> = self.state.facts.proven_switches().collect();
                if proven.is_empty() {
                    Report::Robot(Robot::Ready)
                } else {
                    Report::Contrary(one_of(random, &proven))
                }
            }
            _ => match due {
                Some(due) => Report::Answered { id: due.id, answer: Answer::Failed(one_of(random, &TROUBLES)) },
                None => Report::Robot(Robot::Ready),
            },
        };
        Event::Reported(reported)
    }
}

pub const REQUESTS: [Request; 11] = [
    Request::Reset,
    Request::Start { max_passes: 1, max_moves: 1, dries: false },
    Request::Start { max_passes: 2, max_moves: 2, dries: false },
    Request::AirRun { max_moves: 2 },
    Request::Hold,
    Request::Unhold { dried: false },
    Request::Unhold { dried: true },
    Request::Accept,
    Request::Stop,
    Request::Abort,
    Request::Clear,
];

pub const TROUBLES: [Trouble; 16] = [
    Trouble::Camera,
    Trouble::Picture,
    Trouble::Computing,
    Trouble::Feedback,
    Trouble::Starved,
    Trouble::Slow,
    Trouble::Gate,
    Trouble::Refused,
    Trouble::Short,
    Trouble::Sequence,
    Trouble::Protocol,
    Trouble::Override,
    Trouble::Deviation,
    Trouble::Store,
    Trouble::DiskFull,
    Trouble::Late,
];

pub const ROBOTS: [Robot; 8] = [
    Robot::Ready,
    Robot::LinkLost,
    Robot::Restarted,
    Robot::EmergencyStop,
    Robot::GuardOpen,
    Robot::DrivesOff,
    Robot::NotAutomatic,
    Robot::OtherPrograms,
];

/// Returns all possible answers to an action except failures, including answers of the wrong type.
pub fn answers(act: Action, id: Id) -> Vec<Report> {
    let stands = |done| Answer::Standstill { done };
    let graded = [Grade::Accept, Grade::Review, Grade::Reject].map(Answer::Graded);
    let answers = match act {
        Action::CheckStandstill | Action::EndEpoch { .. } => vec![stands(0)],
        Action::Move(motion) => vec![stands(motion.waypoints), stands(motion.waypoints.saturating_sub(1))],
        Action::OpenEpoch { above } => vec![Answer::Epoch(above + 1), Answer::Epoch(above)],
        Action::SelfTest | Action::SetFrames(_) | Action::Switch(_) | Action::DryPicture => vec![Answer::Done],
        Action::Locate | Action::Assess => graded.to_vec(),
        Action::Refine { .. } | Action::Verify { .. } => [&graded[..], &[Answer::LookOn]].concat(),
        Action::Film => [Film::Whole, Film::Broken, Film::Invalid].map(Answer::Filmed).to_vec(),
        Action::Plan { .. } => {
            let (plan, waypoints) = (7, 3);
            let nothing_left = Answer::Planned { plan: 0, waypoints: 0 };
            let planned = [Answer::Planned { plan, waypoints }, Answer::PlannedForReview { plan, waypoints }];
            [&planned[..], &[nothing_left, graded[2]]].concat()
        }
    };
    answers.into_iter().map(|answer| Report::Answered { id, answer }).collect()
}

/// Returns the name of an action, as the scenarios use it.
fn action_name(act: Action) -> String {
    match act {
        Action::Move(motion) => match motion.path {
            Path::Corner { view } => format!("to-corner-{view}"),
            path => format!("to-{path:?}").to_lowercase(),
        },
        Action::Switch(switch) => format!("{switch:?}").to_lowercase(),
        Action::SetFrames(frames) => format!("frames-{frames:?}").to_lowercase(),
        Action::Refine { view } => format!("corner-{view}"),
        Action::Verify { view: 0 } => "verify".to_owned(),
        Action::Verify { view } => format!("verify-{view}"),
        Action::Plan { pass } => format!("plan-{pass}"),
        Action::OpenEpoch { .. } => "epoch".to_owned(),
        Action::EndEpoch { .. } => "end-epoch".to_owned(),
        other => format!("{other:?}").to_lowercase(),
    }
}

/// A cell in a scenario, and its actions since the last comparison.
pub struct Story {
    pub cell: Cell,
    pub acts: Vec<String>,
    pub films: Vec<Film>,
}

impl Story {
    /// Creates a cell in Idle. `films` are the results of its next films.
    pub fn idle(films: &[Film]) -> Self {
        let films = films.iter().rev().copied().collect();
        let mut story = Story { cell: Cell::new(None), acts: Vec::new(), films };
        story.report(Report::Robot(Robot::Ready));
        story.asked(Request::Reset);
        assert_eq!(
            story.run_until_rest(),
            "checkstandstill epoch tooloff wateroff extractionoff lightoff selftest"
        );
        assert_eq!(story.at(), At::Idle);
        story
    }

    pub fn started(films: &[Film]) -> Self {
        Story::started_by(Request::Start { max_passes: 2, max_moves: 3, dries: false }, films)
    }

    pub fn started_by(start: Request, films: &[Film]) -> Self {
        let mut story = Story::idle(films);
        story.asked(start);
        story
    }

    pub fn at(&self) -> At {
        self.cell.state.at
    }

    pub fn event(&mut self, event: Event) {
        self.cell.feed(event).unwrap_or_else(|wrong| panic!("{wrong}: {:?}", self.cell.journal));
        let acts = self.cell.effects.iter().filter_map(|effect| match effect {
            Effect::Do { act, .. } => Some(action_name(*act)),
            _ => None,
        });
        self.acts.extend(acts);
    }

    pub fn asked(&mut self, request: Request) {
        self.event(Event::Asked(request));
    }

    pub fn report(&mut self, report: Report) {
        self.event(Event::Reported(report));
        // The robot's first state message also reports the override.
        if report == Report::Robot(Robot::Ready) && self.cell.full_override.is_none() {
            self.event(Event::Reported(Report::FullOverride(true)));
        }
    }

    pub fn answer(&mut self, answer: Answer) {
        let id = self.cell.state.due.expect("an act is under way").id;
        self.report(Report::Answered { id, answer });
    }

    /// Reports the next successful answer, or the next deadline that the state waits for.
    pub fn next_healthy_report(&mut self) {
        let waits = [Deadline::Rinse, Deadline::Spray, Deadline::Settle, Deadline::Drain];
        match self.cell.state.due {
            Some(Due { act: Action::Film, .. }) => {
                let film = self.films.pop().expect("a film");
                self.answer(Answer::Filmed(film));
            }
            Some(Due { id, act }) => self.report(answers(act, id)[0]),
            None => {
                let timer = waits.iter().find_map(|wait| self.cell.timers.iter().find(|(which, _)| which == wait));
                let (which, id) = *timer.expect("a deadline is waited for");
                self.report(Report::Deadline { id, which });
            }
        }
    }

    /// Runs the cell until this action is in progress, and returns the actions so far.
    pub fn run_until(&mut self, act: &str) -> String {
        for _ in 0..200 {
            if self.cell.state.due.is_some_and(|due| action_name(due.act) == act) {
                return std::mem::take(&mut self.acts).join(" ");
            }
            self.next_healthy_report();
        }
        panic!("{act} never comes: {:?}", self.cell.state);
    }

    /// Runs the cell until no work is in progress, and returns the actions so far.
    pub fn run_until_rest(&mut self) -> String {
        for _ in 0..200 {
            if self.at().is_at_rest() {
                return std::mem::take(&mut self.acts).join(" ");
            }
            self.next_healthy_report();
        }
        panic!("no rest: {:?}", self.cell.state);
    }

    /// Creates a scenario in contact, after two of three waypoints.
    pub fn in_contact() -> Self {
        let mut story = Story::started(&[Film::Broken, Film::Whole]);
        story.run_until("to-contact");
        let id = story.cell.state.due.expect("the contact path").id;
        story.report(Report::Progress { id, done: 2 });
        story.acts.clear();
        story
    }
}
