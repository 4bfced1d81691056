//! Tests of the journal and the motions: a new process computes its state from the journal of the previous process.
//!
//! A start that reads the journal from its last checkpoint has the same result as one that reads the whole journal.
//! After kill -9, the journal contains all acknowledged lines, and at most one more.

use super::evidence::{change_outside_the_program, store_in, verify};
use super::*;
use panelprep_cell::cycle::{
    self, Action, Answer, At, Cause, Effect, Event, Film, Grade, Id, Outcome, Report, Request, Robot, State, step,
};
use panelprep_cell::record::CycleId;
use proptest::prelude::*;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

pub fn progress(done: u32) -> Event {
    Event::Reported(Report::Progress { id: Id(u64::MAX - 1), done })
}

/// Returns the answer of a cell without faults; every second film breaks.
pub fn answer(act: Action, film: u32) -> Answer {
    match act {
        Action::CheckStandstill | Action::EndEpoch { .. } => Answer::Standstill { done: 0 },
        Action::OpenEpoch { above } => Answer::Epoch(above + 1),
        Action::Move(motion) => Answer::Standstill { done: motion.waypoints },
        Action::Locate | Action::Refine { .. } | Action::Verify { .. } | Action::Assess => {
            Answer::Graded(Grade::Accept)
        }
        Action::Film => Answer::Filmed(if film.is_multiple_of(2) { Film::Broken } else { Film::Whole }),
        Action::Plan { .. } => Answer::Planned { plan: 77, waypoints: 9 },
        Action::SelfTest | Action::SetFrames(_) | Action::Switch(_) | Action::DryPicture => Answer::Done,
    }
}

/// A random walk: a cell without faults and its operator, with random unexpected events.
struct Walk {
    state: State,
    armed: Vec<Event>,
    films: u32,
}

impl Walk {
    fn new() -> Self {
        Walk { state: State::INITIAL, armed: Vec::new(), films: 0 }
    }

    fn usual_event(&mut self) -> Event {
        match (self.state.due, self.state.at) {
            _ if self.state.facts.robot != Robot::Ready => Event::Reported(Report::Robot(Robot::Ready)),
            (Some(due), _) => {
                self.films += u32::from(due.act == Action::Film);
                Event::Reported(Report::Answered { id: due.id, answer: answer(due.act, self.films) })
            }
            (None, At::Stopped | At::Complete { .. }) => Event::Asked(Request::Reset),
            (None, At::Idle) => Event::Asked(Request::Start { max_passes: 2, max_moves: 3, dries: false }),
            (None, At::Held(_)) => Event::Asked(Request::Unhold { dried: true }),
            (None, At::Aborted { .. }) => Event::Asked(Request::Clear),
            _ => self.armed.pop().unwrap_or(Event::Reported(Report::Boot)),
        }
    }

    fn unexpected_event(&mut self, kind: u8) -> Event {
        match kind {
            0 => Event::Asked(Request::Hold),
            1 => Event::Asked(Request::Stop),
            2 => Event::Asked(Request::Abort),
            3 => Event::Reported(Report::Robot(Robot::LinkLost)),
            4 => Event::Reported(Report::Boot),
            _ => self.usual_event(),
        }
    }

    /// Applies an event to the state table, and collects the events that follow from its effects.
    fn step(&mut self, event: Event) -> Vec<Effect> {
        let (state, effects) = step(self.state, event);
        self.state = state;
        let armed = effects.iter().filter_map(|effect| match *effect {
            Effect::Arm { id, deadline: which @ (cycle::Deadline::Rinse | cycle::Deadline::Spray) }
            | Effect::Arm { id, deadline: which @ (cycle::Deadline::Settle | cycle::Deadline::Drain) } => {
                Some(Event::Reported(Report::Deadline { id, which }))
            }
            _ => None,
        });
        self.armed.extend(armed);
        effects
    }
}

/// The part of the control loop that uses the store: the cycle in progress, and the effects that are commits.
struct Loop {
    store: Store,
    running: Option<CycleId>,
}

impl Loop {
    fn append(&mut self, event: &Event, at: At) -> u64 {
        if let (Event::Asked(Request::Start { .. }), At::Idle) = (event, at) {
            self.running = Some(self.store.begin_cycle(&super::cycles::start()).expect("begun"));
        }
        self.store.append(event, self.running).expect("written")
    }

    fn perform(&mut self, effect: &Effect) {
        match effect {
            Effect::OpenIntent(motion) => self.store.open_intent(motion, self.running).expect("opened"),
            Effect::CloseIntent { motion, outcome, done } => {
                self.store.close_intent(motion, *outcome, *done).expect("closed");
            }
            Effect::Conclude { verdict } => {
                if let Some(id) = self.running.take() {
                    drop(self.store.conclude(id, *verdict, &[]).expect("concluded"));
                }
            }
            _ => {}
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// For every sequence of events and every end of the process, the state computed from the journal is the state in
    /// memory, and the rows of motions and cycles agree with the journal.
    #[test]
    fn the_journal_folds_to_the_state_in_memory(
        surprises in prop::collection::vec(0_u8..40, 1..160),
        performed in 0_usize..4,
    ) {
        let (folder, store) = new_store();
        let (mut walk, mut cell) = (Walk::new(), Loop { store, running: None });
        let mut memory = Vec::new();
        let last = surprises.len() - 1;
        for (index, kind) in surprises.into_iter().enumerate() {
            let event = walk.unexpected_event(kind);
            memory.push(event);
            prop_assert_eq!(cell.append(&event, walk.state.at), memory.len() as u64);
            // The process ends after the last event, when only some of its effects were performed.
            let count = if index == last { performed } else { usize::MAX };
            walk.step(event).iter().take(count).for_each(|effect| cell.perform(effect));
        }
        drop(cell);
        let mut store = Store::create(&folder.path().join("store")).expect("opens again");
        prop_assert_eq!(&store.journal().expect("reads back"), &memory);
        let recovered = store.recover().expect("recovers");
        prop_assert_eq!(recovered, cycle::recover(memory));
        prop_assert_eq!(store.has_open_motion().expect("read"), recovered.intent.is_some());
        prop_assert!(recovered.intent.is_none() || recovered.at.keyword() == "aborted");
        prop_assert_eq!(store.open_cycles().expect("read").len(), usize::from(walk.state.job.running));
        prop_assert_eq!(store.recover().expect("again"), recovered);
    }
}

/// Runs a cell without faults until the motion to the corner pose has started.
fn until_moving(cell: &mut Loop) -> (Walk, cycle::Motion) {
    let mut walk = Walk::new();
    for _ in 0..60 {
        let event = walk.usual_event();
        cell.append(&event, walk.state.at);
        walk.step(event).iter().for_each(|effect| cell.perform(effect));
        if let Some(intent) = walk.state.intent {
            return (walk, intent.motion);
        }
    }
    panic!("nothing moves: {:?}", walk.state);
}

#[test]
fn an_open_motion_is_aborted_after_a_restart_until_a_person_clears_it() {
    let (folder, store) = new_store();
    let mut cell = Loop { store, running: None };
    let (_, motion) = until_moving(&mut cell);
    assert!(cell.store.has_open_motion().expect("read"));
    assert!(cell.store.open_intent(&motion, None).is_err(), "one motion at a time");
    drop(cell);
    let mut store = Store::create(&folder.path().join("store")).expect("opens again");
    let recovered = store.recover().expect("recovers");
    assert_eq!(recovered.at, At::Aborted { cause: Cause::Interrupted });
    assert!(store.has_open_motion().expect("read"));

    // Events of the next process: Boot, robot ready, Clear, standstill.
    let mut cell = Loop { running: store.open_cycles().expect("read").first().copied(), store };
    let mut walk = Walk { state: cycle::fold_journal(cell.store.journal().expect("read")), ..Walk::new() };
    let mut event = Event::Reported(Report::Boot);
    for _ in 0..20 {
        cell.append(&event, walk.state.at);
        walk.step(event).iter().for_each(|effect| cell.perform(effect));
        if walk.state.at == At::Stopped {
            break;
        }
        event = walk.usual_event();
    }
    assert_eq!(walk.state.at, At::Stopped);
    assert!(!cell.store.has_open_motion().expect("read"));
    let id = cell.store.newest_cycle().expect("read").expect("a cycle");
    let record = cell.store.cycle(id).expect("whole");
    assert_eq!(
        record.judgement.map(|judgement| judgement.verdict),
        Some(panelprep_base::verdict::Verdict::Aborted)
    );
    assert_eq!(record.motions.last().and_then(|motion| motion.outcome), Some(Outcome::Cleared));
}

#[test]
fn a_motion_that_the_journal_does_not_know_stops_the_start() {
    let (_folder, store) = new_store();
    let mut cell = Loop { store, running: None };
    let (_, motion) = until_moving(&mut cell);
    cell.store.connection.execute("DELETE FROM journal", []).expect("lost");
    assert!(matches!(cell.store.recover(), Err(StoreError::DamagedJournal { .. })));
    assert!(cell.store.close_intent(&cycle::Motion { epoch: 99, ..motion }, Outcome::Done, 1).is_err());
}

#[test]
fn a_changed_lost_or_inserted_line_is_detected() {
    let planted = [
        "UPDATE journal SET event = replace(event, '7', '8') WHERE sequence = 7",
        "UPDATE journal SET unix_ms = unix_ms + 1 WHERE sequence = 7",
        "DELETE FROM journal WHERE sequence = 7",
        "INSERT INTO journal SELECT sequence + 5, cycle_id, unix_ms, event, chain FROM journal WHERE sequence > 7",
        "UPDATE journal SET event = '{}' WHERE sequence = 7",
    ];
    for sql in planted {
        let (_folder, mut store) = new_store();
        for done in 1..=10 {
            store.append(&progress(done), None).expect("written");
        }
        assert_eq!(store.journal().expect("whole").len(), 10);
        store.connection.execute(sql, []).expect(sql);
        let error = store.recover().expect_err(sql).to_string();
        assert!(error.contains("damaged at line"), "{sql}: {error}");
    }
}

/// The disk is full even after the reserve was released: an append fails, acknowledged lines are kept, and the journal
/// can be written again as soon as there is free space.
#[test]
fn a_full_disk_uses_the_reserve_and_then_refuses() {
    let (folder, mut store) = new_store();
    let pages: i64 = store.connection.pragma_query_value(None, "page_count", |row| row.get(0)).expect("counted");
    store.connection.pragma_update_and_check(None, "max_page_count", pages + 3, |_| Ok(())).expect("set");
    let mut written = 0;
    let error = loop {
        match store.append(&progress(written + 1), None) {
            Ok(sequence) => written = sequence as u32,
            Err(error) => break error,
        }
    };
    assert!(written > 10 && matches!(error, StoreError::Full { .. }), "{written}: {error}");
    assert!(error.to_string().contains("is full") && error.to_string().contains("delete"), "{error}");
    let reserve = folder.path().join("store/panelprep.reserve");
    assert!(store.is_disk_full() && !reserve.exists(), "the reserve is the journal's last room");
    assert!(matches!(store.append(&progress(0), None), Err(StoreError::Full { .. })), "still");
    store.connection.pragma_update_and_check(None, "max_page_count", 100_000, |_| Ok(())).expect("set");
    assert_eq!(store.append(&progress(written + 1), None).expect("there is room"), u64::from(written) + 1);
    written += 1;
    assert!(store.has_free_space() && !store.is_disk_full() && reserve.exists(), "it is taken again");
    drop(store);
    let mut store = Store::create(&folder.path().join("store")).expect("opens again");
    let expected: Vec<Event> = (1..=written).map(progress).collect();
    assert_eq!(store.journal().expect("reads back"), expected);
    assert_eq!(store.append(&progress(0), None).expect("continues"), u64::from(written) + 1);
    let mut reader = Store::open(&folder.path().join("store")).expect("for reading");
    assert!(matches!(reader.append(&progress(0), None), Err(StoreError::ReadOnly { .. })));
}

/// A start that reads the journal from the last checkpoint gets the same state.
#[test]
fn a_checkpoint_gives_the_state_of_the_whole_journal() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    for done in 0..2_500 {
        store.append(&progress(done), None).expect("written");
    }
    drop(store);
    let path = store_in(&folder);
    let mut store = Store::create(&path).expect("opens");
    let whole = store.recover().expect("recovers");
    let checkpoint = store.checkpoint().expect("read").expect("a long tail was read");
    assert_eq!((checkpoint.sequence, checkpoint.settled.state()), (2_500, store.state().expect("known")));
    drop(store);
    let mut store = Store::create(&path).expect("opens");
    assert_eq!(store.recover().expect("recovers"), whole);
    store.append(&Event::Reported(Report::Boot), None).expect("written");
    let folded = store.state().expect("known");
    assert_eq!(folded, panelprep_cell::cycle::fold_journal(store.journal().expect("whole")));
}

/// Measures the duration of three starts with this number of journal lines: `cargo test -- --ignored --nocapture
/// a_million`.
fn started(lines: u32) -> [std::time::Duration; 3] {
    let (folder, mut store) = new_store();
    super::super::journal::fill(&mut store, lines).expect("filled");
    drop(store);
    // The first start finds no checkpoint: it reads the whole journal and writes a checkpoint.
    std::array::from_fn(|_| {
        let since = std::time::Instant::now();
        let mut store = Store::create(&store_in(&folder)).expect("opens");
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        let took = since.elapsed();
        assert_eq!(store.lines().expect("counted"), i64::from(lines));
        took
    })
}

#[test]
#[ignore = "a minute: it writes a million lines"]
fn a_start_with_a_million_lines_reads_only_the_last() {
    let took = started(1_000_000);
    eprintln!("start at a million lines: {took:?} (the first one folds all of them)");
    assert!(took[2].as_secs_f64() < 2.0, "{took:?}");
}

/// A start reads only the lines after the last checkpoint, no matter how long the journal is.
#[test]
fn a_start_does_not_read_the_whole_journal() {
    let (folder, mut store) = new_store();
    super::super::journal::fill(&mut store, 30_000).expect("filled");
    store.recover().expect("recovers");
    store.append(&progress(1), None).expect("written");
    drop(store);
    // This change would only be detected by reading the whole journal.
    change_outside_the_program(&folder, "UPDATE journal SET event = '{}' WHERE sequence = 7");
    let mut store = Store::create(&store_in(&folder)).expect("opens");
    assert_eq!(store.recover().expect("the tail alone").at, At::Stopped);
    assert!(store.journal().is_err());
    drop(store);
    assert!(verify(&folder).differences.iter().any(|words| words.contains("journal line 7 ")));
    // A change after the last checkpoint is detected at the start.
    change_outside_the_program(&folder, "UPDATE checkpoints SET folded = replace(folded, 'stopped', 'idle')");
    let store = Store::create(&store_in(&folder)).expect("opens");
    assert!(store.changed().iter().any(|words| words.contains("checkpoint 30000")), "{:?}", store.changed());
}

const FOLDER: &str = "PANELPREP_TEST_APPENDS_TO";

/// The child process of another test: appends and reports lines until it is killed.
#[test]
#[ignore = "run by the test below as a process of its own"]
fn appends_until_killed() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let mut store = Store::create(Path::new(&folder)).expect("the lease of a killed process is free");
    let begin = store.journal().expect("whole").len() as u32;
    println!("begins after {begin}");
    for done in begin + 1.. {
        let sequence = store.append(&progress(done), None).expect("written");
        println!("appended {sequence}");
    }
}

/// Starts this test program as a child process, which executes one test in this folder until it is killed.
pub(super) fn until_killed(test: &str, (variable, folder): (&str, &Path)) -> Child {
    Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env(variable, folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("a child")
}

#[test]
fn a_killed_process_leaves_a_prefix_without_duplicates() {
    let (folder, store) = new_store();
    drop(store);
    let path = folder.path().join("store");
    let mut before = 0;
    for kill in 0..10_u64 {
        let mut child = until_killed("store::tests::journal::appends_until_killed", (FOLDER, &path));
        let reported = BufReader::new(child.stdout.take().expect("its output"));
        let mut acknowledged = None;
        for line in reported.lines().map_while(Result::ok) {
            if let Some(count) = line.strip_prefix("begins after ") {
                assert_eq!(count.parse(), Ok(before), "kill {kill}");
                let refused = Store::create(&path).expect_err("the child writes").to_string();
                assert!(refused.contains(&format!("process {} is writing", child.id())), "{refused}");
            }
            acknowledged =
                line.strip_prefix("appended ").and_then(|count| count.parse::<u64>().ok()).or(acknowledged);
            // After 1 to 28 further lines, the child is killed at an arbitrary moment; the lines that it has reported
            // by then are read as well.
            if acknowledged == Some(before + 1 + kill * 3) {
                child.kill().expect("killed");
            }
        }
        assert!(!child.wait().expect("ended").success());
        let acknowledged = acknowledged.expect("the child appends");
        let journal = Store::open(&path).expect("opens").journal().expect("whole");
        let found = journal.len() as u64;
        assert!(
            (acknowledged..=acknowledged + 1).contains(&found),
            "kill {kill}: {acknowledged} told, {found} there"
        );
        assert_eq!(journal, (1..=found as u32).map(progress).collect::<Vec<_>>());
        before = found;
    }
}
