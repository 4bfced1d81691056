//! Tests of contact paths: for every end of a motion, the permitted waypoints limit the grids that the tool may have
//! touched. Also tests of the disc's wear.

use super::journal::progress;
use super::*;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Event, Id, Motion, Outcome, Path as MotionPath, Report};
use panelprep_cell::record::{
    Bounds, Clock, ContactPath, CycleId, EarlierPass, Finding, FirstReached, Kind, RecordingFile,
};

const MOTION: Motion = Motion { epoch: 3, path: MotionPath::Contact, plan: 0xAB, waypoints: 40 };

fn path() -> ContactPath {
    let reached = |grid: &str, first| FirstReached { grid: grid.to_owned(), first };
    ContactPath { id: Id(9), pass: 1, grids: vec![reached("r1c1", 2), reached("r1c2", 30)], wears_mm2: 900.0 }
}

fn report_progress(store: &mut Store, cycle: CycleId, done: u32) {
    store.append(&Event::Reported(Report::Progress { id: Id(9), done }), Some(cycle)).expect("written");
}

fn earlier(cycle: CycleId, grid: &str, is_sure: bool) -> EarlierPass {
    EarlierPass { cycle, pass: 1, grid: Some(grid.to_owned()), is_sure, is_stated: false }
}

/// The progress of another action, or of an earlier motion, is ignored.
#[test]
fn touched_grids_are_limited_by_reported_and_permitted_waypoints() {
    let (folder, mut store) = new_store();
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    store.open_contact(&MOTION, Some(id), (&path(), 16)).expect("opened");
    assert!(store.open_contact(&MOTION, Some(id), (&path(), 16)).is_err(), "one motion at a time");
    report_progress(&mut store, id, 4);
    store.append(&progress(77), Some(id)).expect("written");
    store.store_permit(20).expect("permitted");
    report_progress(&mut store, id, 7);
    drop(store);
    let mut store = Store::create(&folder.path().join("store")).expect("the next program");
    let motions = store.cycle(id).expect("there").motions;
    assert_eq!(motions[0].executed_bounds(), Some(Bounds { at_least: 7, at_most: 20 }));
    assert_eq!(motions[0].contact.as_ref().map(|contact| &contact.path), Some(&path()));
    store.close_intent(&MOTION, Outcome::Cleared, 0).expect("a person cleared it");
    let cleared = store.cycle(id).expect("there").motions;
    assert_eq!(
        cleared[0].executed_bounds(),
        Some(Bounds { at_least: 7, at_most: 20 }),
        "no person knows more by that"
    );
    assert!(store.store_permit(30).is_err(), "no motion is open");
}

/// The first cycle crashed, the second one was stopped and has a finding, and a later one passed: after it, another
/// part is in the cell.
#[test]
fn possible_abrasions_count_until_the_part_passes() {
    let (_folder, mut store) = new_store();
    let begin = |store: &mut Store| store.begin_cycle(&super::cycles::start()).expect("begun");
    let one = begin(&mut store);
    store.open_contact(&MOTION, Some(one), (&path(), 16)).expect("opened");
    report_progress(&mut store, one, 1);
    store.conclude(one, Verdict::Aborted, &[]).expect("concluded");
    store.close_intent(&MOTION, Outcome::Cleared, 0).expect("cleared");
    let two = begin(&mut store);
    assert_eq!(
        store.earlier_abrasions(two).expect("read"),
        [earlier(one, "r1c1", false)],
        "r1c2 was not permitted"
    );

    store.open_contact(&Motion { epoch: 5, ..MOTION }, Some(two), (&path(), 40)).expect("opened");
    let found = Finding::new(Kind::Abrade, 1, Judgement { verdict: Verdict::Accept, reasons: vec![] });
    store
        .store_finding(two, &found.with_detail("grids", vec!["r1c1"]).with_detail("grids_in_part", vec!["r1c2"]))
        .expect("kept");
    store.close_intent(&Motion { epoch: 5, ..MOTION }, Outcome::Stopped, 33).expect("closed");
    store.conclude(two, Verdict::Aborted, &[]).expect("concluded");
    let other =
        store.begin_cycle(&CycleStart { panel: "fin".to_owned(), ..super::cycles::start() }).expect("begun");
    assert_eq!(store.earlier_abrasions(other).expect("read"), [], "another panel");
    let three = begin(&mut store);
    let counted = [earlier(one, "r1c1", false), earlier(two, "r1c1", true), earlier(two, "r1c2", true)];
    assert_eq!(store.earlier_abrasions(three).expect("read"), counted);
    store.conclude(three, Verdict::Reject, &[Reason::new("overlap", "too little")]).expect("concluded");
    let four = begin(&mut store);
    assert_eq!(
        store.earlier_abrasions(four).expect("read"),
        counted,
        "a panel that was not found is still that part"
    );
    let used = Reason::new(panelprep_cell::record::PASSES_USED, "r1c1 may not be abraded again");
    store.conclude(four, Verdict::Reject, &[used]).expect("concluded");
    let five = begin(&mut store);
    assert_eq!(
        store.earlier_abrasions(five).expect("read"),
        counted,
        "the part that had all of its passes lies there still"
    );
    air_run(&mut store, five);
    let six = begin(&mut store);
    assert_eq!(
        store.earlier_abrasions(six).expect("read"),
        counted,
        "an air-run abrades nothing and ends no count"
    );
    film(&mut store, six, Verdict::Pass);
    let seven = begin(&mut store);
    assert_eq!(store.earlier_abrasions(seven).expect("read"), [], "the part had a result, and is taken out");
}

/// Concludes a cycle as an air-run: with the verdict pass and without a film.
fn air_run(store: &mut Store, id: CycleId) {
    store.conclude(id, Verdict::Pass, &[]).expect("concluded");
}

/// Concludes a cycle with a film that has this verdict.
pub fn film(store: &mut Store, id: CycleId, verdict: Verdict) {
    let found = Finding::new(Kind::Inspect, 0, Judgement { verdict, reasons: vec![] });
    store.store_finding(id, &found).expect("kept");
    store.conclude(id, verdict, &[]).expect("concluded");
}

/// Adds a cycle with this part that was interrupted in contact.
pub fn add_interrupted_cycle(store: &mut Store, (serial, epoch): (&str, u32), another: bool) -> CycleId {
    let id = store.begin_cycle(&start_of(serial, another)).expect("begun");
    let motion = Motion { epoch, ..MOTION };
    store.open_contact(&motion, Some(id), (&path(), 16)).expect("opened");
    store.close_intent(&motion, Outcome::Aborted, 16).expect("closed");
    store.conclude(id, Verdict::Aborted, &[]).expect("concluded");
    id
}

pub fn start_of(serial: &str, another: bool) -> CycleStart {
    let mut start = super::cycles::start();
    if !serial.is_empty() {
        start.file_texts.push(("part".to_owned(), format!("serial = \"{serial}\"\n")));
    }
    if another {
        start.file_texts.push((panelprep_cell::record::ANOTHER_PART_TEXT.to_owned(), "yes".to_owned()));
    }
    start
}

/// Sanding passes are counted for each part. A part is identified by its serial number, regardless of surrounding
/// blanks and case, and by a person's statement. The result of one part does not affect the count of another part.
#[test]
fn abrasions_are_counted_for_each_part() {
    let (_folder, mut store) = new_store();
    let one = add_interrupted_cycle(&mut store, ("SN ü17", 3), false);
    let without_serial = add_interrupted_cycle(&mut store, ("", 4), false);
    let mut counted = |serial: &str, another| {
        let id = store.begin_cycle(&start_of(serial, another)).expect("begun");
        let mut cycles: Vec<i64> =
            store.earlier_abrasions(id).expect("read").iter().map(|pass| pass.cycle.0).collect();
        cycles.dedup();
        (id, cycles)
    };
    let both = vec![one.0, without_serial.0];
    for serial in ["SN ü17", "sn Ü17", " SN ü17 "] {
        assert_eq!(counted(serial, false).1, both, "{serial}: the part without a number may be this one");
    }
    assert_eq!(counted("SN 18", false).1, [without_serial.0], "another number");
    assert_eq!(counted("", false).1, both, "it may be any of them");
    assert_eq!(counted("SN 30", true).1, [0_i64; 0], "a person says so");
    assert_eq!(counted("SN 30", false).1, [0_i64; 0], "and said so before");
    assert_eq!(counted("SN ü17", true).1, [one.0], "its own pass; the part without a number is another one");
    assert_eq!(counted("SN ü17", false).1, [one.0], "as stated before");
    let (other, _) = counted("SN 18", false);
    film(&mut store, other, Verdict::Fail);
    let mut after = |serial: &str| {
        let id = store.begin_cycle(&start_of(serial, false)).expect("begun");
        store
            .earlier_abrasions(id)
            .expect("read")
            .iter()
            .map(|pass| pass.cycle)
            .collect::<std::collections::BTreeSet<_>>()
    };
    assert_eq!(after(""), [one, without_serial].into(), "the result of SN 18 says nothing of them");
    assert_eq!(after("SN 18"), [without_serial].into());
}

/// A part without a serial number that failed may also be the part of the next start: its passes are counted until a
/// start request states a different part, or until it passes. They are also counted if the serial number is omitted
/// after a failed film.
#[test]
fn a_fail_ends_no_count_without_a_serial_number() {
    let (_folder, mut store) = new_store();
    let failed = |store: &mut Store, (serial, epoch), another| {
        let id = add_interrupted_cycle(store, (serial, epoch), another);
        let next = store.begin_cycle(&start_of(serial, false)).expect("begun");
        film(store, next, Verdict::Fail);
        id
    };
    let counted = |store: &mut Store, (serial, another)| -> Vec<CycleId> {
        let id = store.begin_cycle(&start_of(serial, another)).expect("begun");
        store.earlier_abrasions(id).expect("read").iter().map(|pass| pass.cycle).collect()
    };
    let without_serial = failed(&mut store, ("", 3), false);
    assert_eq!(counted(&mut store, ("", false)), [without_serial]);
    assert_eq!(counted(&mut store, ("SN 1", false)), [without_serial], "it may be that part");
    assert_eq!(counted(&mut store, ("", true)), []);
    assert_eq!(counted(&mut store, ("", false)), [], "it was stated before");
    let one = failed(&mut store, ("SN 1", 4), true);
    assert_eq!(counted(&mut store, ("SN 1", false)), [], "its passes over all cycles have their own limit");
    assert_eq!(counted(&mut store, ("", false)), [one], "the serial number was left out");
    let last = store.begin_cycle(&start_of("", false)).expect("begun");
    film(&mut store, last, Verdict::Pass);
    assert_eq!(counted(&mut store, ("", false)), [], "it passed and is taken out");
}

/// The program ended between the event that started the contact and the row of its motion, so no waypoint was
/// permitted.
#[test]
fn a_contact_that_was_never_permitted_touched_nothing() {
    let (_folder, mut store) = new_store();
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    let none = ContactPath { grids: vec![], wears_mm2: 0.0, ..path() };
    store.open_contact(&MOTION, Some(id), (&none, 0)).expect("opened");
    let motion = &store.cycle(id).expect("there").motions[0];
    assert_eq!(
        (motion.executed_bounds(), motion.touched_grids()),
        (Some(Bounds { at_least: 0, at_most: 0 }), Some(vec![]))
    );
}

#[test]
fn a_cycle_keeps_its_clock_and_its_recording() {
    let (_folder, mut store) = new_store();
    let file = RecordingFile::Named("/tmp/a.mcap".to_owned());
    let start = CycleStart { recording: Some(file.clone()), ..super::cycles::start() };
    let id = store.begin_cycle(&start).expect("begun");
    assert_eq!(store.cycle(id).expect("there").clocks, [None, None]);
    let clocks = [Clock::Simulated { at_ms: 100 }, Clock::Simulated { at_ms: 61_500 }];
    clocks.iter().for_each(|clock| store.store_clock(id, *clock).expect("kept"));
    let record = store.cycle(id).expect("there");
    assert_eq!((record.clocks, record.recording), (clocks.map(Some), Some(file)));
}

/// Expected areas, calculated by hand, mm²: 100 + 250.5, then 40 on a new disc.
#[test]
fn wear_adds_up_until_a_new_disc_is_mounted() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut store = Store::create(folder.path()).expect("a new store");
    assert_eq!(store.disc_worn_mm2().expect("known"), 0.0);
    store.wear_disc(None, 100.0).expect("kept");
    store.wear_disc(None, 250.5).expect("kept");
    assert_eq!(store.disc_worn_mm2().expect("known"), 350.5);
    store.mount_disc().expect("kept");
    assert_eq!(store.disc_worn_mm2().expect("known"), 0.0);
    store.wear_disc(None, 40.0).expect("kept");
    assert!(matches!(store.wear_disc(None, f64::NAN), Err(StoreError::NotFinite { .. })));
    drop(store);
    let store = Store::open(folder.path()).expect("for reading");
    assert_eq!(store.disc_worn_mm2().expect("known"), 40.0);
}

#[test]
fn a_store_open_for_reading_records_no_wear() {
    let folder = tempfile::tempdir().expect("a folder");
    drop(Store::create(folder.path()).expect("a new store"));
    let mut store = Store::open(folder.path()).expect("for reading");
    assert!(matches!(store.wear_disc(None, 1.0), Err(StoreError::ReadOnly { .. })));
    assert!(matches!(store.mount_disc(), Err(StoreError::ReadOnly { .. })));
}
