//! What a contact path was permitted bounds what it may have touched, whatever ended it.

use super::journal::progress;
use super::*;
use crate::cycle::{Event, Id, Motion, Outcome, Path as MotionPath, Report};
use crate::record::{Bounds, Clock, ContactPath, CycleId, EarlierPass, Finding, Kind, Reached, RecordingFile};
use crate::verdict::{Judgement, Reason, Verdict};

const MOTION: Motion = Motion { epoch: 3, path: MotionPath::Contact, plan: 0xAB, waypoints: 40 };

fn path() -> ContactPath {
    let reached = |grid: &str, first| Reached { grid: grid.to_owned(), first };
    ContactPath { id: Id(9), pass: 1, grids: vec![reached("r1c1", 2), reached("r1c2", 30)], wears_mm2: 900.0 }
}

fn told(store: &mut Store, cycle: CycleId, done: u32) {
    store.append(&Event::Told(Report::Progress { id: Id(9), done }), Some(cycle)).expect("written");
}

fn earlier(cycle: CycleId, grid: &str, is_sure: bool) -> EarlierPass {
    EarlierPass { cycle, pass: 1, grid: Some(grid.to_owned()), is_sure }
}

/// Another act's progress, and that of an earlier motion, are not this one's.
#[test]
fn an_open_contact_is_bounded_by_what_was_told_and_permitted() {
    let (folder, mut store) = new_store();
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    store.open_contact(&MOTION, Some(id), (&path(), 16)).expect("opened");
    assert!(store.open_contact(&MOTION, Some(id), (&path(), 16)).is_err(), "one motion at a time");
    told(&mut store, id, 4);
    store.append(&progress(77), Some(id)).expect("written");
    store.permit(20).expect("permitted");
    told(&mut store, id, 7);
    drop(store);
    let mut store = Store::create(&folder.path().join("store")).expect("the next program");
    let motions = store.cycle(id).expect("there").motions;
    assert_eq!(motions[0].executed(), Some(Bounds { at_least: 7, at_most: 20 }));
    assert_eq!(motions[0].contact.as_ref().map(|contact| &contact.path), Some(&path()));
    store.close_intent(&MOTION, Outcome::Cleared, 0).expect("a person cleared it");
    let cleared = store.cycle(id).expect("there").motions;
    assert_eq!(cleared[0].executed(), Some(Bounds { at_least: 7, at_most: 20 }), "nobody knows more by that");
    assert!(store.permit(30).is_err(), "no motion is open");
}

/// A crashed cycle, one that was stopped with its finding, then one that passes: after that the next part lies there.
#[test]
fn what_may_have_been_abraded_counts_until_the_part_has_a_result() {
    let (_folder, mut store) = new_store();
    let begin = |store: &mut Store| store.begin_cycle(&super::cycles::start()).expect("begun");
    let one = begin(&mut store);
    store.open_contact(&MOTION, Some(one), (&path(), 16)).expect("opened");
    told(&mut store, one, 1);
    store.conclude(one, Verdict::Aborted, &[]).expect("concluded");
    store.close_intent(&MOTION, Outcome::Cleared, 0).expect("cleared");
    let two = begin(&mut store);
    assert_eq!(store.abraded_before(two).expect("read"), [earlier(one, "r1c1", false)], "r1c2 was not permitted");

    store.open_contact(&Motion { epoch: 5, ..MOTION }, Some(two), (&path(), 40)).expect("opened");
    let found = Finding::new(Kind::Abrade, 1, Judgement { verdict: Verdict::Accept, reasons: vec![] });
    store.note(two, &found.detail("grids", vec!["r1c1"]).detail("grids_in_part", vec!["r1c2"])).expect("kept");
    store.close_intent(&Motion { epoch: 5, ..MOTION }, Outcome::Stopped, 33).expect("closed");
    store.conclude(two, Verdict::Aborted, &[]).expect("concluded");
    let other =
        store.begin_cycle(&CycleStart { panel: "fin".to_owned(), ..super::cycles::start() }).expect("begun");
    assert_eq!(store.abraded_before(other).expect("read"), [], "another panel");
    let three = begin(&mut store);
    let counted = [earlier(one, "r1c1", false), earlier(two, "r1c1", true), earlier(two, "r1c2", true)];
    assert_eq!(store.abraded_before(three).expect("read"), counted);
    store.conclude(three, Verdict::Reject, &[Reason::new("overlap", "too little")]).expect("concluded");
    let four = begin(&mut store);
    assert_eq!(store.abraded_before(four).expect("read"), counted, "a panel that was not found is still that part");
    let used = Reason::new(crate::record::PASSES_USED, "r1c1 may not be abraded again");
    store.conclude(four, Verdict::Reject, &[used]).expect("concluded");
    let five = begin(&mut store);
    assert_eq!(store.abraded_before(five).expect("read"), [], "nothing more was allowed of that part");
    store.open_contact(&Motion { epoch: 8, ..MOTION }, Some(five), (&path(), 40)).expect("opened");
    store.close_intent(&Motion { epoch: 8, ..MOTION }, Outcome::Done, 40).expect("closed");
    store.conclude(five, Verdict::Pass, &[]).expect("concluded");
    let six = begin(&mut store);
    assert_eq!(store.abraded_before(six).expect("read"), []);
}

/// The program ended between the event that began contact and the row of its motion: nothing was permitted.
#[test]
fn a_contact_that_was_never_permitted_touched_nothing() {
    let (_folder, mut store) = new_store();
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    let none = ContactPath { grids: vec![], wears_mm2: 0.0, ..path() };
    store.open_contact(&MOTION, Some(id), (&none, 0)).expect("opened");
    let motion = &store.cycle(id).expect("there").motions[0];
    assert_eq!((motion.executed(), motion.touched()), (Some(Bounds { at_least: 0, at_most: 0 }), Some(vec![])));
}

#[test]
fn a_cycle_keeps_its_clock_and_its_recording() {
    let (_folder, mut store) = new_store();
    let file = RecordingFile::Named("/tmp/a.mcap".to_owned());
    let start = CycleStart { recording: Some(file.clone()), ..super::cycles::start() };
    let id = store.begin_cycle(&start).expect("begun");
    assert_eq!(store.cycle(id).expect("there").clocks, [None, None]);
    let clocks = [Clock::Simulated { at_ms: 100 }, Clock::Simulated { at_ms: 61_500 }];
    clocks.iter().for_each(|clock| store.keep_clock(id, *clock).expect("kept"));
    let record = store.cycle(id).expect("there");
    assert_eq!((record.clocks, record.recording), (clocks.map(Some), Some(file)));
}
