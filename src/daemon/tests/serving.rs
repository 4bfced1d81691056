//! The service: computing aside, orders, self-tests.

use super::fake::{Cell as Fake, FakeEyes};
use super::*;
use crate::cycle::{self, Act, Answer, Event, Hold, Refusal, Report, State, Trouble, Why};
use crate::geometry::{ColorPicture, OrganizedCloud};
use crate::record::{CycleId, Front, Kind, Who};
use crate::supervision::ThreadFault;
use crate::verdict::Reason;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

type When = Box<dyn FnMut(&State) -> bool>;

/// Asks each thing when its time has come, then leaves.
#[derive(Default)]
pub struct Script {
    steps: VecDeque<(When, What)>,
    refusals: Vec<(cycle::Request, Refusal)>,
    pub verdicts: Vec<Verdict>,
    cycles: Vec<CycleId>,
    noted: Vec<Reason>,
    unable: Vec<String>,
}

impl Script {
    pub fn when(mut self, when: impl FnMut(&State) -> bool + 'static, what: What) -> Self {
        self.steps.push_back((Box::new(when), what));
        self
    }

    pub fn reset(self) -> Self {
        let ready = |state: &State| {
            state.at == At::Stopped && state.facts.robot == crate::cycle::Robot::Ready
                || matches!(state.at, At::Complete { .. })
        };
        self.when(ready, What::Table(cycle::Request::Reset))
    }

    pub fn start(self, cell: &Fake) -> Self {
        self.when(|state| state.at == At::Idle, What::Begin(Box::new(cell.prepared())))
    }

    pub fn leave_when(self, when: impl FnMut(&State) -> bool + 'static) -> Self {
        self.when(when, What::Leave)
    }
}

impl Requests for Script {
    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let next = self.steps.pop_front_if(|(when, _)| when(state));
        Ok(next.map(|(_, what)| Request::new(what, Who::by(Front::Socket))))
    }

    fn refused(&mut self, request: cycle::Request, refusal: Refusal) {
        self.refusals.push((request, refusal));
    }

    fn unable(&mut self, reasons: Vec<Reason>) {
        self.unable.extend(reasons.iter().map(|reason| reason.code.to_string()));
    }

    fn begun(&mut self, cycle: CycleId, _: crate::tape::Begin) {
        self.cycles.push(cycle);
    }

    fn concluded(&mut self, verdict: Verdict) {
        self.verdicts.push(verdict);
    }

    fn noted(&mut self, reasons: &[Reason]) {
        self.noted.extend_from_slice(reasons);
    }
}

pub fn complete(state: &State) -> bool {
    matches!(state.at, At::Complete { .. })
}

#[test]
fn cycles_come_one_after_the_other() {
    let cell = Fake::new(Scene::Good);
    let mut script = Script::default().reset().start(&cell).reset().start(&cell).leave_when(complete);
    cell.serve(|eyes| eyes, vec![], &mut script);
    assert_eq!(script.verdicts, [Verdict::Pass, Verdict::Pass]);
    assert_eq!(script.cycles, [CycleId(1), CycleId(2)]);
    assert_eq!(script.refusals, []);
}

/// The disc is changed while the cell is held for it; the result is accepted, and its wear begins anew.
#[test]
fn a_new_disc_goes_on_after_a_review() {
    let mut cell = Fake::new(Scene::Good);
    (cell.more_recipe, cell.worn_mm2) = ("[path]\ndisc_life_mm2 = 1000000\n", 999_900.0);
    let held = |state: &State| matches!(state.at, At::Held(_));
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(|state| matches!(state.at, At::Execute(_)), What::NewDisc)
        .when(held, What::NewDisc)
        .when(held, What::Table(cycle::Request::Accept))
        .leave_when(complete);
    let record = cell.serve(|eyes| eyes, vec![], &mut script);
    assert_eq!(script.verdicts, [Verdict::Pass]);
    assert_eq!(script.unable, ["not_now"], "not while the cell works");
    assert!((1_000.0..900_000.0).contains(&record.worn_mm2), "{}", record.worn_mm2);
}

/// The same cycle, computed here and aside: the same events, in the same order.
#[test]
fn where_it_is_computed_does_not_matter() {
    let here = Fake::new(Scene::Good).run(super::fake::Asks::one_cycle()).events;
    let cell = Fake::new(Scene::Good);
    let mut script = Script::default().reset().start(&cell).leave_when(complete);
    let aside = cell.serve(|eyes| eyes, vec![], &mut script).events;
    assert_eq!(here, aside);
}

/// Eyes with something about them.
struct Odd {
    eyes: FakeEyes,
    /// The first scan takes until somebody lets it go on.
    go_on: Option<Receiver<()>>,
    /// What a check finds.
    wrong: Vec<SightError>,
    /// Pictures of each film that nobody takes over in time.
    drops: Range<u64>,
    taken: u64,
}

impl Odd {
    fn new(eyes: FakeEyes) -> Self {
        Odd { eyes, go_on: None, wrong: vec![], drops: 0..0, taken: 0 }
    }
}

impl Eyes for Odd {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        if let Some(go_on) = self.go_on.take() {
            // Far longer than the test takes: where the loop waits for this scan, it is not let go on.
            let why = |_| SightError { camera: "the scanner", why: "the loop waited for it".to_owned() };
            go_on.recv_timeout(Duration::from_secs(30)).map_err(why)?;
        }
        self.eyes.scan()
    }

    fn picture(&mut self) -> Result<Picture2d, SightError> {
        self.eyes.picture()
    }

    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, SightError> {
        self.taken = 0;
        self.eyes.begin_film(pictures_per_second)
    }

    fn next_of_film(&mut self) -> Result<Option<Picture2d>, SightError> {
        let Some(picture) = self.eyes.next_of_film()? else { return Ok(None) };
        self.taken += 1;
        Ok(Some(picture).filter(|_| !self.drops.contains(&self.taken)))
    }

    fn end_film(&mut self) -> Result<u64, SightError> {
        self.eyes.end_film().map(|none| none + self.drops.end - self.drops.start)
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        self.eyes.corner_picture()
    }

    fn check(&mut self) -> Vec<SightError> {
        self.wrong.clone()
    }
}

/// What the camera dropped is missing in its times: the film is no test, whatever it shows, and says how many.
#[test]
fn dropped_pictures_are_a_gap_in_time() {
    let cell = Fake::new(Scene::Clean);
    let held = |state: &State| matches!(state.at, At::Held(_) | At::Complete { .. });
    let mut script = Script::default().reset().start(&cell).leave_when(held);
    let record = cell.serve(|eyes| Odd { drops: 5..11, ..Odd::new(eyes) }, vec![], &mut script);
    let film = record.findings.iter().find(|finding| finding.kind == Kind::Inspect).expect("watched");
    let codes: Vec<String> = film.judgement.reasons.iter().map(|reason| reason.code.to_string()).collect();
    assert!(film.judgement.verdict == Verdict::Invalid && codes.contains(&"gap".to_owned()), "{film:?}");
    assert_eq!(film.number("pictures that were dropped"), Some(6.0));
    // By hand: one in two seconds; after the fourth, which came at six, the eleventh came at twenty.
    let longest_s = film.number("longest time between two of them").expect("measured");
    assert!((longest_s - 14.0).abs() < 1e-6, "{longest_s}");
}

/// A stop while the scan is under way ends in Stopped before the scan does; what the scan then finds is dropped, and
/// the next cycle makes its own.
#[test]
fn a_stop_does_not_wait_for_a_computation() {
    let cell = Fake::new(Scene::Clean);
    let (let_go, go_on) = mpsc::channel();
    let locates = |state: &State| matches!(state.due, Some(due) if due.act == Act::Locate);
    let stopped = move |state: &State| {
        let rests = state.at == At::Stopped;
        if rests {
            let _ = let_go.send(());
        }
        rests
    };
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(locates, What::Table(cycle::Request::Stop))
        .when(stopped, What::Table(cycle::Request::Reset))
        .start(&cell)
        .leave_when(complete);
    let record = cell.serve(|eyes| Odd { go_on: Some(go_on), ..Odd::new(eyes) }, vec![], &mut script);
    assert_eq!(script.verdicts, [Verdict::Aborted, Verdict::Pass]);
    let told = script.noted.iter().filter(|reason| reason.code == "stopped").count();
    assert_eq!(told, 1, "a stop on request is told as one: {:?}", script.noted);
    let located = record.findings.iter().filter(|finding| finding.kind == Kind::Locate).count();
    assert_eq!(located, 1, "the scan of the cycle that was stopped leaves nothing");
    let graded = |event: &&Event| matches!(event, Event::Told(Report::Answered { answer: Answer::Graded(_), .. }));
    let stop = record.events.iter().position(|event| *event == Event::Asked(cycle::Request::Stop)).expect("asked");
    assert_eq!(record.events[..stop].iter().filter(graded).count(), 0, "it was under way");
}

/// An order that the table refuses begins no cycle.
#[test]
fn an_order_out_of_turn_begins_nothing() {
    let cell = Fake::new(Scene::Clean);
    let early = What::Begin(Box::new(cell.prepared()));
    let heard = |state: &State| state.facts.robot == crate::cycle::Robot::Ready;
    let mut script = Script::default().when(heard, early).leave_when(|_| true);
    cell.serve(|eyes| eyes, vec![], &mut script);
    assert_eq!((script.cycles.len(), script.refusals.len()), (0, 1));
    assert_eq!(script.refusals[0].1, Refusal::NotNow);
}

/// Each thing that is wrong is a reason, and the reset ends in Stopped.
#[test]
fn a_self_test_names_all_that_is_wrong() {
    let failed = |script: &Script| matches!(script.refusals[..], [(cycle::Request::Reset, Refusal::Failed(_))]);
    let codes = |script: &Script| script.noted.iter().map(|reason| reason.code.to_string()).collect::<Vec<_>>();
    let until = |mut seen: bool| {
        move |state: &State| {
            seen |= state.at == At::Resetting;
            seen && state.at == At::Stopped
        }
    };
    let cell = Fake::new(Scene::Clean);
    let unreadable = Reason::new("calibration", "scanner.toml: no such file");
    let wrong = vec![SightError { camera: "the scanner", why: "its cable is out".to_owned() }];
    let mut script = Script::default().reset().leave_when(until(false));
    cell.serve(|eyes| Odd { wrong, ..Odd::new(eyes) }, vec![unreadable], &mut script);
    assert!(failed(&script), "{:?}", script.refusals);
    assert_eq!(codes(&script), ["camera", "calibration"]);

    let full = Fake::new(Scene::Clean).with_full_disk();
    let mut script = Script::default().reset().leave_when(until(false));
    full.serve(|eyes| eyes, vec![], &mut script);
    assert!(failed(&script) && codes(&script) == ["disk_full"], "{:?}", script.noted);
}

/// The disk fills while the cell works: it is held where it rests and says so, and goes on only once there is room.
#[test]
fn a_full_disk_holds_the_cell_until_there_is_room() {
    let held = |state: &State| matches!(state.at, At::Held(Hold { why: Why::Trouble(Trouble::DiskFull), .. }));
    let mut cell = Fake::new(Scene::Good);
    cell.fills_at = Some(30);
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(held, What::Table(cycle::Request::Unhold { dried: true }))
        .when(held, What::Table(cycle::Request::Unhold { dried: true }))
        .when(|state| matches!(state.at, At::Unholding { .. } | At::Execute(_)), What::Table(cycle::Request::Stop))
        .leave_when(|state| state.at == At::Stopped);
    let record = cell.serve(|eyes| eyes, vec![], &mut script);
    assert_eq!(
        (script.unable, script.refusals),
        (vec!["disk_full".to_owned()], vec![]),
        "once, then there is room"
    );
    assert!(script.noted.iter().any(|reason| reason.message.contains("delete recordings")));
    let full = record.events.iter().filter(|event| **event == Event::Told(Report::Trouble(Trouble::DiskFull)));
    assert_eq!(full.count(), 1);
    assert!(record.intents.iter().all(|(_, end)| end.is_some()), "every motion has its end");
}
