//! A search finds exactly the cycles that match it.

use super::*;
use crate::history::{Acknowledgement, Hits, Query, RequiredEnd};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Motion, Path as MotionPath, Request};
use panelprep_cell::record::{Answer, CycleId, Finding, Kind, PartNames, RequestRecord, RequestedAction};

fn part(serial: &str, order: &str, operator: &str) -> PartNames {
    let name = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
    PartNames { serial: name(serial), order: name(order), operator: name(operator) }
}

fn begin(store: &mut Store, panel: &str, part: &PartNames) -> CycleId {
    let mut start = CycleStart { panel: panel.to_owned(), ..super::cycles::start() };
    start.file_texts.push((PartNames::FILE.to_owned(), toml::to_string(part).expect("TOML")));
    store.begin_cycle(&start).expect("begun")
}

/// Creates four cycles: 1 and 2 with the part SN-1, 3 with SN-10, which is still in progress, and 4 without a part.
fn four() -> (TempDir, Store) {
    let (folder, mut store) = new_store();
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_000);
    let one = begin(&mut store, "wing", &part("SN-1", "W-4", "Ada"));
    store
        .conclude(one, Verdict::Reject, &[Reason::new("low_overlap", "85 % was seen, allowed 100_% at \"most\"")])
        .expect("1");
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_secs(2_000);
    let two = begin(&mut store, "wing", &part("SN-1", "W-5", "ada"));
    store.conclude(two, Verdict::Pass, &[]).expect("2");
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_secs(3_000);
    begin(&mut store, "fin", &part("SN-10", "", "Grace"));
    let four = store.begin_cycle(&super::cycles::start()).expect("begun");
    let motion = Motion { epoch: 3, path: MotionPath::Air, plan: 7, waypoints: 200 };
    store.open_intent(&motion, Some(four)).expect("opened");
    store.conclude(four, Verdict::Pass, &[Reason::new("note", "a note")]).expect("4");
    (folder, store)
}

fn found(store: &Store, query: Query) -> Vec<i64> {
    let Hits { hits, .. } = store.search(&Query { limit: 10, ..query }).expect("searched");
    hits.into_iter().map(|hit| hit.cycle.0).collect()
}

#[test]
fn each_condition_finds_what_it_states() {
    let (_folder, store) = four();
    let name = |text: &str| Some(text.to_owned());
    let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let all = Query::default;
    for (query, expected) in [
        (all(), vec![4, 3, 2, 1]),
        (Query { serial: name("sn-1"), ..all() }, vec![2, 1]),
        (Query { serial: name("SN-1*"), ..all() }, vec![3, 2, 1]),
        (Query { serial: name("SN_1"), ..all() }, vec![]),
        (Query { serial: name("SN_1*"), ..all() }, vec![]),
        (Query { order: name("W-5"), ..all() }, vec![2]),
        (Query { operator: name("ADA"), ..all() }, vec![2, 1]),
        (Query { panel: name("fin"), ..all() }, vec![3]),
        (Query { from_unix_s: Some(2_000), until_unix_s: Some(3_000), ..all() }, vec![2]),
        (Query { end: Some(RequiredEnd::Running), ..all() }, vec![3]),
        (Query { end: Some(RequiredEnd::With(Verdict::Pass)), ..all() }, vec![4, 2]),
        (Query { words: words("OVERLAP seen"), ..all() }, vec![1]),
        (Query { words: words("overlap note"), ..all() }, vec![]),
        // % and _ are ordinary characters in a search, and the names of JSON keys are not searched.
        (Query { words: words("100_%"), ..all() }, vec![1]),
        (Query { words: words("100%"), ..all() }, vec![]),
        (Query { words: words("10__%"), ..all() }, vec![]),
        (Query { words: words("message"), ..all() }, vec![]),
        (Query { words: words("\"most\""), ..all() }, vec![1]),
    ] {
        assert_eq!(found(&store, query.clone()), expected, "{query:?}");
    }
}

#[test]
fn a_cycle_is_found_with_its_part_verdict_and_reasons() {
    let (_folder, store) = four();
    let hits = store.search(&Query { limit: 10, ..Query::default() }).expect("searched").hits;
    let airs: Vec<bool> = hits.iter().map(|hit| hit.is_air_run).collect();
    assert_eq!(airs, [true, false, false, false], "a pass in the air is none of the panel");
    assert_eq!((hits[1].verdict, hits[1].ended_unix_s, &hits[1].part), (None, None, &part("SN-10", "", "Grace")));
    assert_eq!(hits[3].part, part("SN-1", "W-4", "Ada"));
    assert_eq!((hits[3].verdict, &*hits[3].reasons[0].code), (Some(Verdict::Reject), "low_overlap"));
    assert_eq!(store.cycle_part(CycleId(1)).expect("read"), Some(part("SN-1", "W-4", "Ada")));
    assert_eq!(store.cycle_part(CycleId(4)).expect("read"), None);
}

/// With pages of one cycle, a cycle that begins between two pages is not on the second page.
#[test]
fn pages_follow_each_other_while_cycles_begin() {
    let (_folder, mut store) = four();
    let mut query = Query { limit: 1, ..Query::default() };
    let mut seen = Vec::new();
    loop {
        let Hits { hits, next } = store.search(&query).expect("searched");
        seen.extend(hits.iter().map(|hit| hit.cycle.0));
        begin(&mut store, "wing", &part("SN-99", "", ""));
        assert!(seen.len() <= 4, "a page comes twice: {seen:?}");
        if next.is_none() {
            break;
        }
        query.before_cycle = next;
    }
    assert_eq!(seen, [4, 3, 2, 1]);
}

/// The table is an index: a change in it is detected by comparison with the authoritative text.
#[test]
fn a_changed_part_is_named() {
    for (sql, words) in [
        ("UPDATE cycle_parts SET serial = 'SN-2' WHERE cycle_id = 1", "changed: the part of cycle 1 differs"),
        ("DELETE FROM cycle_parts WHERE cycle_id = 2", "deleted: the part of cycle 2"),
        ("INSERT INTO cycle_parts (cycle_id, serial) VALUES (4, 'SN-4')", "inserted: a part of cycle 4"),
    ] {
        let (folder, store) = four();
        drop(store);
        let path = folder.path().join("store");
        Connection::open(path.join(DATABASE)).expect("opened").execute_batch(sql).expect("changed");
        let found = Store::verify(&path, false).expect("verified").differences;
        assert!(found.iter().any(|found| found.contains(words)), "{words}: {found:?}");
    }
}

#[test]
fn the_time_of_a_finding_is_stored_and_in_the_chain() {
    let (folder, mut store) = four();
    let id = CycleId(3);
    let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(3_000_250);
    store.store_finding(id, &Finding::new(Kind::Locate, 0, judgement.clone())).expect("kept");
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(3_100_500);
    store.store_finding(id, &Finding::new(Kind::Inspect, 0, judgement)).expect("kept");
    assert_eq!(store.finding_times_unix_ms(id).expect("read"), [3_000_250, 3_100_500]);
    drop(store);
    let path = folder.path().join("store");
    let change = "UPDATE findings SET unix_ms = 1 WHERE id = 2";
    Connection::open(path.join(DATABASE)).expect("opened").execute_batch(change).expect("changed");
    let found = Store::verify(&path, false).expect("verified").differences;
    assert!(found.iter().any(|words| words.contains("changed: finding 2")), "{found:?}");
}

#[test]
fn acknowledgements_are_stored_permanently_with_their_time() {
    let (folder, mut store) = four();
    let seen = |code: &str| Acknowledgement {
        unix_ms: 0,
        cycle: Some(CycleId(1)),
        code: code.to_owned(),
        raised_unix_ms: 1_000_000,
        who: "Ada".to_owned(),
    };
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(4_000_125);
    store.acknowledge(&seen("low_overlap")).expect("kept");
    store.acknowledge(&Acknowledgement { cycle: None, ..seen("store_changed") }).expect("kept");
    let kept = store.acknowledgements(Some(CycleId(1))).expect("read");
    assert_eq!(kept, [Acknowledgement { unix_ms: 4_000_125, ..seen("low_overlap") }]);
    assert_eq!(store.acknowledgements(None).expect("read")[0].code, "store_changed");
    assert!(
        store.acknowledge(&Acknowledgement { cycle: Some(CycleId(99)), ..seen("x") }).is_err(),
        "no such cycle"
    );
    drop(store);
    let path = folder.path().join("store");
    Connection::open(path.join(DATABASE))
        .expect("opened")
        .execute_batch("DELETE FROM acknowledgements WHERE id = 1")
        .expect("gone");
    let found = Store::verify(&path, false).expect("verified").differences;
    assert!(found.iter().any(|words| words.contains("deleted: acknowledgement 1 is missing")), "{found:?}");
}

/// The times are those of the store: the time of the finding, and the time of the reset after the end. A later cycle,
/// which is still in progress, began after the reset.
#[test]
fn an_alarm_lasts_until_the_cell_is_reset_or_the_next_cycle_begins() {
    let (_folder, mut store) = new_store();
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(1_000_000);
    let id = begin(&mut store, "wing", &part("SN-1", "", ""));
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(1_004_250);
    let reasons = vec![Reason::new("shift_limit", "moved 80 mm (limit 60 mm)")];
    store
        .store_finding(
            id,
            &Finding::new(Kind::Locate, 0, Judgement { verdict: Verdict::Reject, reasons: reasons.clone() }),
        )
        .expect("kept");
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(1_009_900);
    store.conclude(id, Verdict::Reject, &reasons).expect("concluded");
    let gone = |store: &Store| {
        let alarms = store.alarms(id).expect("read");
        assert_eq!(
            alarms.iter().map(|alarm| (&*alarm.code, alarm.raised_unix_ms)).collect::<Vec<_>>(),
            [("shift_limit", 1_004_250)]
        );
        alarms[0].gone_unix_ms
    };
    assert_eq!(gone(&store), None);
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(1_030_000);
    begin(&mut store, "wing", &part("SN-1", "", ""));
    assert_eq!(gone(&store), Some(1_030_000));
    let reset = RequestRecord {
        unix_ms: 0,
        wanted: RequestedAction::For(Request::Reset),
        who: None,
        answer: Some(Answer::Done),
        reasons: vec![],
        findings: None,
    };
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(1_020_500);
    store.store_request(&reset, None, None).expect("kept");
    assert_eq!(gone(&store), Some(1_020_500), "the first of both");
}

/// Expected areas, calculated by hand: 100 + 50 mm² on one disc, then 30 mm² on a new disc.
#[test]
fn the_wear_of_the_disc_is_reported_as_it_was_at_the_end_of_each_cycle() {
    let (_folder, mut store) = new_store();
    let [one, two, three, none] = std::array::from_fn(|_| begin(&mut store, "wing", &part("SN-1", "", "")));
    store.wear_disc(Some(one), 100.0).expect("worn");
    store.wear_disc(Some(two), 80.0).expect("worn");
    store.wear_disc(Some(two), -30.0).expect("corrected");
    store.mount_disc().expect("mounted");
    store.wear_disc(Some(three), 30.0).expect("worn");
    let disc = |id| store.past_cycle(id).expect("read").disc.map(|disc| (disc.swept_mm2, disc.worn_mm2));
    assert_eq!([one, two, three].map(disc), [Some((100.0, 100.0)), Some((50.0, 150.0)), Some((30.0, 30.0))]);
    assert_eq!(disc(none), None);
    assert_eq!(store.cycle_panels().expect("read"), ["wing"]);
}
