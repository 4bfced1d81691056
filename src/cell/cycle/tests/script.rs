//! Functions for writing the test scenarios.

use super::super::rules::Rules;
use super::super::*;
use super::cell::Cell;
use super::healthy::answers;

/// Returns the name of an action in the scenarios.
fn word(act: Action) -> String {
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

/// A cell in a scenario, with the actions since the last check.
pub struct Story {
    pub cell: Cell,
    pub acts: Vec<String>,
    pub films: Vec<Film>,
}

impl Story {
    /// Creates a cell in Idle, with the results of its future films.
    pub fn idle(films: &[Film]) -> Self {
        let films = films.iter().rev().copied().collect();
        let mut story = Story { cell: Cell::new(Rules::ALL), acts: Vec::new(), films };
        story.report(Report::Robot(Robot::Ready));
        story.asked(Request::Reset);
        assert_eq!(story.rests(), "checkstandstill epoch tooloff wateroff extractionoff lightoff selftest");
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
            Effect::Do { act, .. } => Some(word(*act)),
            _ => None,
        });
        self.acts.extend(acts);
    }

    pub fn asked(&mut self, request: Request) {
        self.event(Event::Asked(request));
    }

    pub fn report(&mut self, report: Report) {
        self.event(Event::Reported(report));
        // The robot's first state also reports the override.
        if report == Report::Robot(Robot::Ready) && self.cell.full_override.is_none() {
            self.event(Event::Reported(Report::FullOverride(true)));
        }
    }

    pub fn answer(&mut self, answer: Answer) {
        let id = self.cell.state.due.expect("an act is under way").id;
        self.report(Report::Answered { id, answer });
    }

    /// Reports the next good answer, or the next deadline that is awaited.
    pub fn good_news(&mut self) {
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

    /// Continues until this action is in progress; returns the actions until then.
    pub fn until(&mut self, act: &str) -> String {
        for _ in 0..200 {
            if self.cell.state.due.is_some_and(|due| word(due.act) == act) {
                return std::mem::take(&mut self.acts).join(" ");
            }
            self.good_news();
        }
        panic!("{act} never comes: {:?}", self.cell.state);
    }

    /// Continues until nothing is in progress; returns the actions until then.
    pub fn rests(&mut self) -> String {
        for _ in 0..200 {
            if self.at().is_at_rest() {
                return std::mem::take(&mut self.acts).join(" ");
            }
            self.good_news();
        }
        panic!("no rest: {:?}", self.cell.state);
    }

    /// Creates a scenario in contact, with two of three waypoints executed.
    pub fn in_contact() -> Self {
        let mut story = Story::started(&[Film::Broken, Film::Whole]);
        story.until("to-contact");
        let id = story.cell.state.due.expect("the contact path").id;
        story.report(Report::Progress { id, done: 2 });
        story.acts.clear();
        story
    }
}
