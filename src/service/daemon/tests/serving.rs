//! Tests the service: computing in parallel, requests, and self-tests.

use super::fake::{Cell as Fake, FakeCameras};
use super::*;
use crate::daemon::abrasion::AbrasionWork;
use crate::daemon::computing::{WorkInput, WorkOutcome, WorkResult};
use crate::daemon::perception::Perception;
use panelprep_base::supervision::ThreadFault;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{self, Action, Answer, Effect, Event, Hold, Id, Refusal, Report, State, Trouble, Why};
use panelprep_cell::record::{CycleId, Kind, RequestAuthor, RequestSource};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

type When = Box<dyn FnMut(&State) -> bool>;

/// Sends each request when its condition is satisfied, then requests to leave.
#[derive(Default)]
pub struct Script {
    steps: VecDeque<(When, RequestKind)>,
    refusals: Vec<(cycle::Request, Refusal)>,
    pub verdicts: Vec<Verdict>,
    cycles: Vec<CycleId>,
    noted: Vec<Reason>,
    unable: Vec<String>,
    not_permitted: Vec<String>,
}

impl Script {
    pub fn when(mut self, when: impl FnMut(&State) -> bool + 'static, what: RequestKind) -> Self {
        self.steps.push_back((Box::new(when), what));
        self
    }

    pub fn reset(self) -> Self {
        let ready = |state: &State| {
            state.at == At::Stopped && state.facts.robot == panelprep_cell::cycle::Robot::Ready
                || matches!(state.at, At::Complete { .. })
        };
        self.when(ready, RequestKind::Table(cycle::Request::Reset))
    }

    pub fn start(self, cell: &Fake) -> Self {
        self.when(|state| state.at == At::Idle, RequestKind::Begin(Box::new(cell.prepared())))
    }

    pub fn leave_when(self, when: impl FnMut(&State) -> bool + 'static) -> Self {
        self.when(when, RequestKind::Leave)
    }
}

impl Requester for Script {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let next = self.steps.pop_front_if(|(when, _)| when(state));
        Ok(next.map(|(_, what)| Request::new(what, RequestAuthor::from_source(RequestSource::Socket))))
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        match news {
            LoopEvent::Refused(request, refusal) => self.refusals.push((request, refusal)),
            LoopEvent::Unable(reasons) => self.unable.extend(reasons.iter().map(|reason| reason.code.to_string())),
            LoopEvent::NotPermitted(reasons) => {
                self.not_permitted.extend(reasons.iter().map(|reason| reason.code.to_string()));
            }
            LoopEvent::Begun(cycle, _) => self.cycles.push(cycle),
            LoopEvent::Concluded(verdict) => self.verdicts.push(verdict),
            LoopEvent::Noted(reasons) => self.noted.extend(reasons),
            LoopEvent::Filmed(_) | LoopEvent::DiscMounted => {}
        }
    }
}

pub fn complete(state: &State) -> bool {
    matches!(state.at, At::Complete { .. })
}

#[test]
fn cycles_run_one_after_the_other() {
    let cell = Fake::new(Scene::Good);
    let mut script = Script::default().reset().start(&cell).reset().start(&cell).leave_when(complete);
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!(script.verdicts, [Verdict::Pass, Verdict::Pass]);
    assert_eq!(script.cycles, [CycleId(1), CycleId(2)]);
    assert_eq!(script.refusals, []);
}

/// The disc is changed while the cell is held because of its wear. The result is accepted, and the wear of the disc is
/// then counted from zero.
#[test]
fn a_new_disc_continues_after_a_review() {
    let mut cell = Fake::new(Scene::Good);
    (cell.more_recipe, cell.worn_mm2) = ("[path]\ndisc_life_mm2 = 1000000\n", 999_900.0);
    let held = |state: &State| matches!(state.at, At::Held(_));
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(|state| matches!(state.at, At::Execute(_)), RequestKind::NewDisc)
        .when(held, RequestKind::NewDisc)
        .when(held, RequestKind::Table(cycle::Request::Accept))
        .leave_when(complete);
    let record = cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!(script.verdicts, [Verdict::Pass]);
    assert_eq!(script.unable, ["not_now"], "not while the cell works");
    assert!((1_000.0..900_000.0).contains(&record.worn_mm2), "{}", record.worn_mm2);
}

/// The warning output is on once for each start from rest, for the time in the cell's file, and is switched off before
/// the arm moves.
#[test]
fn the_cell_warns_before_it_moves() {
    let mut cell = Fake::new(Scene::Clean);
    (cell.more_io, cell.more_cell) = (["warning = 6\n", ""], "warning_s = 2.5\n");
    let story = cell.run(super::fake::Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    let (set, moved_ms) = story.warning_ms;
    let [(on_ms, true), (off_ms, false)] = set[..] else { panic!("{set:?}") };
    assert!(off_ms - on_ms >= 2_500 && moved_ms.is_some_and(|moved_ms| moved_ms >= off_ms), "{set:?} {moved_ms:?}");
    let silent = Fake::new(Scene::Clean).run(super::fake::Asks::one_cycle());
    assert_eq!(silent.warning_ms.0, [], "a cell without the output");
}

/// A stop is sent to the robot before the loop receives it. A command that the loop sends in between is not a fault,
/// and the state table stops the cycle.
#[test]
fn a_command_after_a_directly_sent_stop_is_no_fault() {
    let cell = Fake::new(Scene::Clean);
    let mut is_stopped = cell.stops_before_a_command();
    let mut has_begun = false;
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(
            move |state| {
                has_begun |= matches!(state.at, At::Execute(cycle::Phase::Locate));
                has_begun && is_stopped() || matches!(state.at, At::Aborted { .. })
            },
            RequestKind::Table(cycle::Request::Stop),
        )
        .leave_when(|state| state.at.is_at_rest());
    cell.serve(|cameras| cameras, vec![], &mut script);
    let codes: Vec<&str> = script.noted.iter().map(|reason| &*reason.code).collect();
    assert!(codes.contains(&"stopped") && !codes.contains(&"not_sent"), "{codes:?}");
    assert_eq!((script.refusals, script.verdicts), (vec![], vec![Verdict::Aborted]));
}

/// If no stop ended the epoch, a command without an open epoch is a fault, and the cycle does not continue.
#[test]
fn a_command_without_an_epoch_is_a_fault() {
    let cell = Fake::new(Scene::Clean);
    let mut is_stopped = cell.stops_before_a_command();
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(
            move |state| {
                if matches!(state.at, At::Execute(cycle::Phase::Locate)) {
                    is_stopped();
                }
                matches!(state.at, At::Held(_)) || state.at.is_at_rest() && state.at != At::Idle
            },
            RequestKind::Table(cycle::Request::Stop),
        )
        .leave_when(|state| state.at.is_at_rest());
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert!(script.noted.iter().any(|reason| reason.code == "not_sent"), "{:?}", script.noted);
    assert_eq!(script.verdicts, [Verdict::Aborted]);
}

/// The first start is refused, because the switch must be at local. After the switch is set, the same start is
/// accepted.
#[test]
fn a_start_is_accepted_from_the_selected_side() {
    let mut cell = Fake::new(Scene::Clean);
    cell.more_io = ["", "local_control = 6\n"];
    let (remote, local) = (cell.turns_to_local(false), cell.turns_to_local(true));
    let idle = |state: &State| state.at == At::Idle;
    let mut script = Script::default()
        .reset()
        .when(move |state| idle(state) && remote(), RequestKind::NewDisc)
        .start(&cell)
        .when(move |state| idle(state) && local(), RequestKind::NewDisc)
        .start(&cell)
        .leave_when(complete);
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!((script.not_permitted, script.verdicts), (vec!["local_control".to_owned()], vec![Verdict::Pass]));
}

/// The same cycle, computed in the loop and in parallel, has the same events in the same order.
#[test]
fn computing_in_the_loop_and_in_parallel_gives_equal_events() {
    let here = Fake::new(Scene::Good).run(super::fake::Asks::one_cycle()).events;
    let cell = Fake::new(Scene::Good);
    let mut script = Script::default().reset().start(&cell).leave_when(complete);
    let aside = cell.serve(|cameras| cameras, vec![], &mut script).events;
    assert_eq!(here, aside);
}

/// Cameras with faults.
struct FaultyCameras {
    cameras: FakeCameras,
    /// The first scan lasts until the test releases it.
    go_on: Option<Receiver<()>>,
    /// The faults that the check of the cameras reports.
    wrong: Vec<CameraFault>,
    /// The indices of the pictures of each film that are dropped.
    drops: Range<u64>,
    taken: u64,
}

impl FaultyCameras {
    fn new(cameras: FakeCameras) -> Self {
        FaultyCameras { cameras, go_on: None, wrong: vec![], drops: 0..0, taken: 0 }
    }
}

impl Port<CameraCommand> for FaultyCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        match command {
            CameraCommand::Scan => {
                if let Some(go_on) = self.go_on.take() {
                    // This time is much longer than the test: if the loop waited for this scan, nothing would release
                    // the scan.
                    let why = |_| CameraFault { camera: "the scanner", why: "the loop waited for it".to_owned() };
                    go_on.recv_timeout(Duration::from_secs(30)).map_err(why)?;
                }
            }
            CameraCommand::BeginFilm(_) => self.taken = 0,
            CameraCommand::Check => return Ok(CameraAnswer::Checked(self.wrong.clone())),
            _ => {}
        }
        let answer = self.cameras.perform(command)?;
        Ok(match (command, answer) {
            (CameraCommand::NextOfFilm, CameraAnswer::Picture(picture)) => {
                self.taken += 1;
                if self.drops.contains(&self.taken) {
                    CameraAnswer::NoneDue
                } else {
                    CameraAnswer::Picture(picture)
                }
            }
            (_, CameraAnswer::FilmEnded(none)) => CameraAnswer::FilmEnded(none + self.drops.end - self.drops.start),
            (_, answer) => answer,
        })
    }
}

/// With the wall clock, the loop does not request the next picture of the film: each picture is evaluated when the
/// camera delivers it, whatever the robot does.
#[test]
fn a_film_continues_without_the_robot() {
    let fake = Fake::new(Scene::Clean);
    let (mut computing, setup) = (fake.computing(), Arc::new(fake.setup()));
    let mut perception = Perception::default();
    let mut seen_s = Vec::new();
    for (id, act) in [(1, Action::Locate), (2, Action::DryPicture), (3, Action::Film)] {
        fake.light(act != Action::Locate);
        fake.time_passes(500);
        let (abrasion, setup) = (AbrasionWork::default(), Some(setup.clone()));
        let work = WorkInput {
            id: Id(id),
            action: act,
            is_next_picture: false,
            perception,
            abrasion,
            tip: None,
            pass: 1,
            setup,
        };
        computing.submit(work);
        let worked = next_result(&mut computing).expect("in time");
        seen_s.extend(film_duration_s(&worked));
        perception = worked.artifacts.expect("not lost").0;
    }
    // The first picture is available immediately, then one every two seconds.
    for passes_ms in [0, 2_000, 2_000, 2_000] {
        fake.time_passes(passes_ms);
        seen_s.extend(film_duration_s(&next_result(&mut computing).expect("in time")));
    }
    assert_eq!(seen_s, [0.0, 0.0, 2.0, 4.0, 6.0]);
    computing.abandon();
    fake.time_passes(2_000);
    assert!(computing.ready(Duration::from_millis(200)).is_none(), "no person waits for it any more");
}

/// Returns the next result, if it arrives within a time that is sufficient even on a busy machine.
fn next_result(computing: &mut Computing) -> Option<WorkResult> {
    computing.ready(Duration::from_secs(60))?;
    computing.ready_result()
}

fn film_duration_s(worked: &WorkResult) -> Option<f64> {
    match worked.outcome {
        Ok(WorkOutcome::Watching { seen_s }) => Some(seen_s),
        _ => None,
    }
}

/// If the camera drops pictures, the times of the pictures have gaps. The film is then not a valid test, whatever it
/// shows, and the number of dropped pictures is reported.
#[test]
fn dropped_pictures_are_a_gap_in_time() {
    let cell = Fake::new(Scene::Clean);
    let held = |state: &State| matches!(state.at, At::Held(_) | At::Complete { .. });
    let mut script = Script::default().reset().start(&cell).leave_when(held);
    let record =
        cell.serve(|cameras| FaultyCameras { drops: 5..11, ..FaultyCameras::new(cameras) }, vec![], &mut script);
    let film = record.findings.iter().find(|finding| finding.kind == Kind::Inspect).expect("watched");
    let codes: Vec<String> = film.judgement.reasons.iter().map(|reason| reason.code.to_string()).collect();
    assert!(film.judgement.verdict == Verdict::Invalid && codes.contains(&"gap".to_owned()), "{film:?}");
    assert_eq!(film.number("pictures that were dropped"), Some(6.0));
    // Expected value, calculated by hand: with one picture every two seconds, the fourth picture was captured at 6 s.
    // The next received picture is the eleventh, at 20 s.
    let longest_s = film.number("longest time between two of them").expect("measured");
    assert!((longest_s - 14.0).abs() < 1e-6, "{longest_s}");
}

/// A stop during the scan leads to Stopped before the scan ends. The result of the scan is discarded, and the next
/// cycle captures its own scan.
#[test]
fn a_stop_does_not_wait_for_a_computation() {
    let cell = Fake::new(Scene::Clean);
    let (let_go, go_on) = mpsc::channel();
    let locates = |state: &State| matches!(state.due, Some(due) if due.act == Action::Locate);
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
        .when(locates, RequestKind::Table(cycle::Request::Stop))
        .when(stopped, RequestKind::Table(cycle::Request::Reset))
        .start(&cell)
        .leave_when(complete);
    let record = cell.serve(
        |cameras| FaultyCameras { go_on: Some(go_on), ..FaultyCameras::new(cameras) },
        vec![],
        &mut script,
    );
    assert_eq!(script.verdicts, [Verdict::Aborted, Verdict::Pass]);
    let reported = script.noted.iter().filter(|reason| reason.code == "stopped").count();
    assert_eq!(reported, 1, "a stop on request is reported as one: {:?}", script.noted);
    let located = record.findings.iter().filter(|finding| finding.kind == Kind::Locate).count();
    assert_eq!(located, 1, "the scan of the cycle that was stopped leaves nothing");
    let graded =
        |event: &&Event| matches!(event, Event::Reported(Report::Answered { answer: Answer::Graded(_), .. }));
    let stop = record.events.iter().position(|event| *event == Event::Asked(cycle::Request::Stop)).expect("asked");
    assert_eq!(record.events[..stop].iter().filter(graded).count(), 0, "it was under way");
}

/// A start that the state table refuses begins no cycle.
#[test]
fn a_refused_start_begins_no_cycle() {
    let cell = Fake::new(Scene::Clean);
    let early = RequestKind::Begin(Box::new(cell.prepared()));
    let heard = |state: &State| state.facts.robot == panelprep_cell::cycle::Robot::Ready;
    let mut script = Script::default().when(heard, early).leave_when(|_| true);
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!((script.cycles.len(), script.refusals.len()), (0, 1));
    assert_eq!(script.refusals[0].1, Refusal::NotNow);
}

/// The controller reports another checksum than the accepted one: Reset and Start have no effect. With the accepted
/// checksum, the reset succeeds.
#[test]
fn programs_that_were_not_accepted_prevent_reset_and_start() {
    let other = cycle::Robot::OtherPrograms;
    let mut cell = Fake::new(Scene::Clean);
    cell.more_cell = "[robot]\nprograms_sum = 2\n";
    let heard = |state: &State| state.facts.robot == cycle::Robot::OtherPrograms;
    let prepared = cell.prepared();
    let start = prepared.request;
    let mut script = Script::default()
        .when(heard, RequestKind::Table(cycle::Request::Reset))
        .when(heard, RequestKind::Begin(Box::new(prepared)))
        .leave_when(heard);
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!(script.cycles, []);
    assert_eq!(
        script.refusals,
        [(cycle::Request::Reset, Refusal::Robot(other)), (start, Refusal::NotNow)],
        "without a reset there is no start"
    );
    // The checksum changes while the cell is idle: the pending request is refused.
    let mut idle = State { at: At::Idle, ..State::INITIAL };
    idle.facts.robot = other;
    let (after, effects) = cycle::step(idle, Event::Asked(start));
    let refused = Effect::Refuse { request: start, refusal: Refusal::Robot(other) };
    assert!(after.at == At::Idle && effects.contains(&refused), "{effects:?}");

    let mut cell = Fake::new(Scene::Clean);
    cell.more_cell = "[robot]\nprograms_sum = 1\n";
    let mut script = Script::default().reset().leave_when(|state| state.at == At::Idle);
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!(script.refusals, []);
}

/// A real controller is connected through a tunnel to this computer, without signed acceptance tests: no motion is
/// started, and a cycle that began with a mock controller does not continue when the real controller answers.
#[test]
fn a_real_controller_at_an_address_of_this_computer_does_not_move() {
    let tunnel = "[robot]\nkind = \"eki\"\nhost = \"127.0.0.1\"\nprograms_sum = 1\n";
    let mut cell = Fake::new(Scene::Clean);
    cell.more_cell = tunnel;
    cell.becomes_real()();
    let heard = |state: &State| state.facts.robot == cycle::Robot::Ready;
    let start = RequestKind::Begin(Box::new(cell.prepared()));
    let mut script = Script::default().when(heard, start).leave_when(|_| true);
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!((script.not_permitted, script.cycles), (vec!["stage_not_signed".to_owned()], vec![]));

    let mut cell = Fake::new(Scene::Clean);
    cell.more_cell = tunnel;
    let becomes_real = cell.becomes_real();
    let ends = move |state: &State| {
        if matches!(state.at, At::Execute(cycle::Phase::Locate)) {
            becomes_real();
        }
        matches!(state.at, At::Held(_) | At::Aborted { .. })
    };
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(ends, RequestKind::Table(cycle::Request::Stop))
        .leave_when(|state| state.at.is_at_rest());
    cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!((script.not_permitted, script.cycles.len()), (vec![], 1), "a mock needs no proofs");
    assert!(script.noted.iter().any(|reason| reason.code == "stage_not_signed"), "{:?}", script.noted);
    assert_eq!(script.verdicts, [Verdict::Aborted]);
}

/// Each problem has a reason, and the reset ends in Stopped.
#[test]
fn a_self_test_reports_all_problems() {
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
    let wrong = vec![CameraFault { camera: "the scanner", why: "its cable is out".to_owned() }];
    let mut script = Script::default().reset().leave_when(until(false));
    cell.serve(|cameras| FaultyCameras { wrong, ..FaultyCameras::new(cameras) }, vec![unreadable], &mut script);
    assert!(failed(&script), "{:?}", script.refusals);
    assert_eq!(codes(&script), ["camera", "calibration"]);

    let full = Fake::new(Scene::Clean).with_full_disk();
    let mut script = Script::default().reset().leave_when(until(false));
    full.serve(|cameras| cameras, vec![], &mut script);
    assert!(failed(&script) && codes(&script) == ["disk_full"], "{:?}", script.noted);
}

/// The disk becomes full while a cycle is running: the cell is held at the next rest and reports this. The cycle
/// continues only when there is free space.
#[test]
fn a_full_disk_holds_the_cell_until_there_is_space() {
    let held = |state: &State| matches!(state.at, At::Held(Hold { why: Why::Trouble(Trouble::DiskFull), .. }));
    let mut cell = Fake::new(Scene::Good);
    cell.fills_at = Some(30);
    let mut script = Script::default()
        .reset()
        .start(&cell)
        .when(held, RequestKind::Table(cycle::Request::Unhold { dried: true }))
        .when(held, RequestKind::Table(cycle::Request::Unhold { dried: true }))
        .when(
            |state| matches!(state.at, At::Unholding { .. } | At::Execute(_)),
            RequestKind::Table(cycle::Request::Stop),
        )
        .leave_when(|state| state.at == At::Stopped);
    let record = cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!(
        (script.unable, script.refusals),
        (vec!["disk_full".to_owned()], vec![]),
        "once, then there is room"
    );
    assert!(script.noted.iter().any(|reason| reason.message.contains("delete recordings")));
    let full = record.events.iter().filter(|event| **event == Event::Reported(Report::Trouble(Trouble::DiskFull)));
    assert_eq!(full.count(), 1);
    assert!(record.intents.iter().all(|(_, end)| end.is_some()), "every motion has its end");
}
