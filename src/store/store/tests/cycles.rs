//! Tests that the records of the cell are complete: cycles with their numbers, requests with sender and result, pages
//! of the acceptance tests with their signatures, and verifications in order.

use super::super::CycleCounts;
use super::*;
use ProofsResult::{Proven, Signed, Wrong};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::ProofStage::{self, A, B, C};
use panelprep_cell::cell::SignedPage;
use panelprep_cell::cycle::{Event, Motion, Outcome, Path, Path as MotionPath, Request};
use panelprep_cell::record::{
    Answer, Budget, Check, CycleId, Finding, KeptFile, Kind, Limit, LimitSource, MotionRecord, Picture,
    ProofsResult, RequestAuthor, RequestRecord, RequestSource, RequestedAction,
};
use panelprep_vision::calib::health::{Strike, Verification};
use std::collections::BTreeMap;

pub fn start() -> CycleStart {
    CycleStart {
        panel: "wing".to_owned(),
        taught_version: "0123456789abcdef".to_owned(),
        recipe_text: "panel = \"wing\"\n".to_owned(),
        file_texts: vec![
            ("cell".to_owned(), "[limits]\n".to_owned()),
            ("scanner".to_owned(), "fx_px = 1\n".to_owned()),
        ],
        recording: None,
        is_air_run: false,
    }
}

fn finding(picture: &str) -> Finding {
    let number = Check::new("residual", "mm", 0.1 + 0.2).with_limit(Limit::AtMost(1.0 / 3.0), LimitSource::Program);
    let reasons = vec![Reason::new("overlap", "0.85 of the panel, allowed 0.9")];
    Finding {
        kind: Kind::Locate,
        pass: 0,
        judgement: Judgement { verdict: Verdict::Review, reasons },
        checks: vec![number, Check::new("drift", "mm", None)],
        details: BTreeMap::from([("base_from_panel".to_owned(), serde_json::json!({"x_mm": 1e-17}))]),
        pictures: vec![Picture {
            name: "located".to_owned(),
            caption: "outline".to_owned(),
            hash: picture.to_owned(),
        }],
        shots: vec![KeptFile { name: "scan".to_owned(), hash: picture.to_owned() }],
    }
}

#[test]
fn a_cycle_reads_back_bit_for_bit() {
    let (folder, mut store) = new_store();
    let id = store.begin_cycle(&start()).expect("begun");
    let running = store.cycle(id).expect("there");
    assert_eq!((running.judgement, running.ended_unix_s, running.budget), (None, None, None));
    let picture = store.store_blob(b"jpeg").expect("kept");
    store.store_finding(id, &finding(&picture)).expect("kept");
    store.store_finding(id, &Finding { kind: Kind::Abrade, pass: 1, ..finding(&picture) }).expect("kept");
    let motion = Motion { epoch: 3, path: MotionPath::Contact, plan: u64::MAX, waypoints: 200 };
    store.open_intent(&motion, Some(id)).expect("opened");
    store.close_intent(&motion, Outcome::Held, 17).expect("closed");
    store.append(&Event::Asked(Request::Hold), Some(id)).expect("written");
    store.append(&Event::Asked(Request::Stop), None).expect("written");
    let budget = Budget { locate_mm: Some(0.15), stated_mm: Some(0.8), ..Budget::default() };
    store.set_budget(id, &budget).expect("kept");
    store.conclude(id, Verdict::Fail, &[Reason::new("passes", "2 of 2 passes")]).expect("kept");
    drop(store);

    let store = Store::open(&folder.path().join("store")).expect("for reading");
    let record = store.cycle(id).expect("there");
    assert_eq!(
        (record.id, record.panel.as_str(), record.program_version.as_str()),
        (id, "wing", env!("CARGO_PKG_VERSION"))
    );
    assert_eq!(record.findings, [finding(&picture), Finding { kind: Kind::Abrade, pass: 1, ..finding(&picture) }]);
    assert_eq!(record.motions, [MotionRecord { motion, outcome: Some(Outcome::Held), done: 17, contact: None }]);
    assert_eq!((record.budget, record.events), (Some(budget), 1));
    let asked: Vec<_> = record.asked.iter().map(|asked| (asked.wanted.clone(), asked.answer)).collect();
    let hold = RequestedAction::For(Request::Hold);
    assert_eq!(asked, [(hold, None)], "in this cycle, not before or after it; its answer was not kept");
    let judgement = record.judgement.expect("over");
    let codes: Vec<&str> = judgement.reasons.iter().map(|reason| &*reason.code).collect();
    assert_eq!((judgement.verdict, codes), (Verdict::Review, vec!["overlap", "passes"]), "no person decided");
    assert!(record.started_unix_s > 1_700_000_000 && record.ended_unix_s >= Some(record.started_unix_s));
    // The hashes in the record are sufficient to read the inputs.
    assert_eq!(store.blob(&record.recipe_hash).expect("kept"), start().recipe_text.as_bytes());
    let files: Vec<_> =
        record.files.iter().map(|file| (file.name.as_str(), store.blob(&file.hash).expect("kept"))).collect();
    assert_eq!(files, [("cell", b"[limits]\n".to_vec()), ("scanner", b"fx_px = 1\n".to_vec())]);
    assert_eq!(store.newest_cycle().expect("read"), Some(id));
}

#[test]
fn invalid_rows_of_a_cycle_are_refused() {
    let (_folder, mut store) = new_store();
    let id = store.begin_cycle(&start()).expect("begun");
    let picture = store.store_blob(b"jpeg").expect("kept");
    let mut spoilt = finding(&picture);
    spoilt.checks[0].value = Some(f64::NAN);
    assert!(store.store_finding(id, &spoilt).expect_err("NaN").to_string().contains("'residual'"));
    spoilt.checks[0] = Check::new("shift", "mm", 1.0).with_limit(Limit::Below(f64::INFINITY), LimitSource::Program);
    assert!(store.store_finding(id, &spoilt).is_err());
    assert!(store.store_finding(id, &finding(&"0".repeat(64))).is_err(), "a picture that is not there");
    assert!(store.store_finding(CycleId(9), &finding(&picture)).is_err(), "no such cycle");
    assert!(store.set_budget(id, &Budget { fit_mm: Some(f64::NAN), ..Budget::default() }).is_err());
    assert_eq!(store.cycle(id).expect("there").findings, []);
    assert!(store.cycle(CycleId(9)).expect_err("none").to_string().contains("no cycle 9"));
    store.conclude(id, Verdict::Pass, &[]).expect("once");
    assert!(store.conclude(id, Verdict::Fail, &[]).expect_err("twice").to_string().contains("no running cycle 1"));
    assert_eq!(store.cycle(id).expect("there").judgement.map(|judgement| judgement.verdict), Some(Verdict::Pass));
}

#[test]
fn cycles_are_counted_once_they_are_over() {
    let (_folder, mut store) = new_store();
    assert_eq!(store.cycle_counts().expect("counted"), CycleCounts::default());
    for (verdict, path) in
        [(Verdict::Pass, Path::Contact), (Verdict::Fail, Path::Contact), (Verdict::Pass, Path::Air)]
    {
        let id = store.begin_cycle(&start()).expect("begun");
        let motion = Motion { epoch: 1, path, plan: 1, waypoints: 5 };
        store.open_intent(&motion, Some(id)).expect("opened");
        store.close_intent(&motion, Outcome::Done, 5).expect("closed");
        store.conclude(id, verdict, &[]).expect("kept");
    }
    store.begin_cycle(&start()).expect("begun");
    let counts = CycleCounts { ended: 3, passed: 2, contacts: 2 };
    assert_eq!(store.cycle_counts().expect("counted"), counts, "the fourth one still runs");
}

fn asked(wanted: RequestedAction, answer: Answer) -> RequestRecord {
    let who =
        RequestAuthor { front: RequestSource::Socket, uid: Some(1_000), user: Some("ada".to_owned()), from: None };
    let reasons = match answer {
        Answer::Done => vec![],
        _ => vec![Reason::new("not_now", "not in this state")],
    };
    RequestRecord { unix_ms: 0, wanted, who: Some(who), answer: Some(answer), reasons, findings: None }
}

fn ask(store: &mut Store, request: Request, cycle: Option<CycleId>, answer: Answer) {
    let line = store.append(&Event::Asked(request), cycle).expect("written");
    store.store_request(&asked(RequestedAction::For(request), answer), cycle, Some(line)).expect("kept");
}

fn words(asked: &[RequestRecord]) -> Vec<(RequestedAction, Option<Answer>)> {
    asked.iter().map(|asked| (asked.wanted.clone(), asked.answer)).collect()
}

/// Between the two cycles, a disc is mounted and a Clear is refused. In the second cycle, one request is refused, and
/// the program ends before the answer to another request is stored.
#[test]
fn requests_belong_to_their_cycle_with_their_answers() {
    let (folder, mut store) = new_store();
    let one = store.begin_cycle(&start()).expect("begun");
    ask(&mut store, Request::Start { max_passes: 2, max_moves: 3, dries: false }, Some(one), Answer::Done);
    store.conclude(one, Verdict::Pass, &[]).expect("concluded");
    ask(&mut store, Request::Clear, None, Answer::Refused);
    store.store_request(&asked(RequestedAction::NewDisc, Answer::Done), None, None).expect("kept");
    let two = store.begin_cycle(&start()).expect("begun");
    ask(&mut store, Request::Start { max_passes: 2, max_moves: 3, dries: false }, Some(two), Answer::Done);
    ask(&mut store, Request::Accept, Some(two), Answer::Refused);
    store.append(&Event::Asked(Request::Hold), Some(two)).expect("written");
    store.store_request(&asked(RequestedAction::NewDisc, Answer::Refused), Some(two), None).expect("kept");
    drop(store);

    let store = Store::open(&folder.path().join("store")).expect("for reading");
    let (first, second) = (store.cycle(one).expect("there"), store.cycle(two).expect("there"));
    let start = RequestedAction::For(Request::Start { max_passes: 2, max_moves: 3, dries: false });
    assert_eq!(words(&first.asked), [(start.clone(), Some(Answer::Done))]);
    assert_eq!(words(&first.asked_before), []);
    let between = [
        (RequestedAction::For(Request::Clear), Some(Answer::Refused)),
        (RequestedAction::NewDisc, Some(Answer::Done)),
    ];
    assert_eq!(words(&second.asked_before), between);
    let mut during = words(&second.asked);
    assert!(during.contains(&(RequestedAction::For(Request::Hold), None)), "its answer is not known: {during:?}");
    during.retain(|(wanted, _)| *wanted != RequestedAction::For(Request::Hold));
    assert_eq!(
        during,
        [
            (start, Some(Answer::Done)),
            (RequestedAction::For(Request::Accept), Some(Answer::Refused)),
            (RequestedAction::NewDisc, Some(Answer::Refused))
        ]
    );
    let accept =
        &second.asked.iter().find(|asked| asked.wanted == RequestedAction::For(Request::Accept)).expect("there");
    assert_eq!(accept.who.as_ref().and_then(|who| who.user.as_deref()), Some("ada"));
    assert!(accept.unix_ms > 1_700_000_000_000 && accept.reasons[0].code == "not_now");
    let mut reader = store;
    assert!(matches!(
        reader.store_request(&asked(RequestedAction::NewDisc, Answer::Done), None, None),
        Err(StoreError::ReadOnly { .. })
    ));
}

/// Five requests have the same time; pages of two requests contain each request once.
#[test]
fn pages_contain_each_request_of_one_millisecond_once() {
    let (_folder, mut store) = new_store();
    store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(2_000);
    let request = asked(RequestedAction::NewDisc, Answer::Done);
    (0..5).for_each(|_| store.store_request(&request, None, None).expect("kept"));
    let (mut before, mut pages) = (None, Vec::new());
    loop {
        let page = store.requests(before, 2).expect("read");
        let Some(last) = page.last() else { break };
        before = Some(TrailPosition { unix_ms: last.request.unix_ms, number: last.number });
        pages.push(page.iter().map(|kept| kept.number).collect::<Vec<_>>());
    }
    assert_eq!(pages, [vec![5, 4], vec![3, 2], vec![1]]);
}

fn page(stage: ProofStage, programs_sum: i32, result: ProofsResult) -> ProofsPage {
    ProofsPage { stage, programs_sum, page_sha256: "ab".repeat(32), by: "Ada".to_owned(), result }
}

/// The newest signature is returned, with the first stage with a test that failed after it. Other rows have no effect,
/// and a page without a signature is not a signed one.
#[test]
fn the_newest_signature_is_read_back() {
    let (folder, store) = new_store();
    drop(store);
    let folder = folder.path().join("store");
    let who = RequestAuthor::from_source(RequestSource::Command);
    let newest_signed = || {
        let store = Store::open(&folder).expect("for reading");
        store.signed_proofs().expect("read")
    };
    assert_eq!(newest_signed(), None);
    let signed = |stage, programs_sum, wrong_since| Some(SignedPage { stage, programs_sum, wrong_since });
    for (row, expected) in [
        (page(A, 7, Proven), None),
        (page(A, 7, Wrong), None),
        (page(A, 7, Signed), signed(A, 7, None)),
        (page(B, 7, Signed), signed(B, 7, None)),
        (page(C, 7, Proven), signed(B, 7, None)),
        // Tests failed later in two stages: the lower stage is returned.
        (page(B, 7, Wrong), signed(B, 7, Some(B))),
        (page(A, 7, Wrong), signed(B, 7, Some(A))),
        (page(C, 7, Wrong), signed(B, 7, Some(A))),
        (page(B, 7, Proven), signed(B, 7, Some(A))),
        // The programs were changed, so the acceptance tests start again.
        (page(A, 8, Signed), signed(A, 8, None)),
    ] {
        Store::store_proofs_in(&folder, &row, who.clone()).expect("stored");
        assert_eq!(newest_signed(), expected, "{row:?}");
    }
    let pages = Store::open(&folder).expect("for reading").proofs().expect("read");
    assert_eq!((pages.len(), &pages[0], &pages[9]), (10, &page(A, 8, Signed), &page(A, 7, Proven)));
}

/// A row with a stage that this version does not know is an error: an older signature must not be used instead of it.
#[test]
fn a_signature_of_an_unknown_stage_is_an_error() {
    let (folder, store) = new_store();
    drop(store);
    let folder = folder.path().join("store");
    let who = RequestAuthor::from_source(RequestSource::Command);
    Store::store_proofs_in(&folder, &page(C, 7, Signed), who).expect("stored");
    let wanted = RequestedAction::Proofs {
        stage: "D".to_owned(),
        programs_sum: 7,
        page_sha256: String::new(),
        by: "Ada".to_owned(),
        result: Signed,
    };
    let row = RequestRecord {
        unix_ms: 0,
        wanted,
        who: None,
        answer: Some(Answer::Done),
        reasons: vec![],
        findings: None,
    };
    let mut store = Store::open_for_one_row(&folder).expect("for writing");
    store.insert_request(&row, None, None).expect("stored");
    let found = store.signed_proofs();
    assert!(found.as_ref().is_err_and(|error| error.to_string().contains("\"D\"")), "{found:?}");
}

pub fn verified(subject: &str, error: f64) -> Verification {
    let hash = calibration_hash(&["lens", "mount"]);
    let subject = subject.to_owned();
    Verification { subject, error, limit: 0.5, calibration_hash: hash, at_unix_s: 7, struck: None }
}

#[test]
fn verifications_are_kept_by_subject_and_the_last_one_counts() {
    let (folder, mut store) = new_store();
    assert_eq!(store.newest_verification("scanner").expect("read"), None);
    let all = [verified("scanner", 0.1), verified("tool", 0.3), verified("scanner", 0.2)];
    for verification in &all {
        store.store_verification(verification).expect("kept");
    }
    assert!(store.store_verification(&verified("scanner", f64::NAN)).expect_err("NaN").to_string().contains("NaN"));
    drop(store);
    let mut store = Store::open(&folder.path().join("store")).expect("the same store");
    assert_eq!(store.verifications("scanner").expect("read"), [all[0].clone(), all[2].clone()]);
    assert_eq!(store.newest_verification("tool").expect("read"), Some(all[1].clone()));
    assert!(matches!(store.store_verification(&all[0]), Err(StoreError::ReadOnly { .. })));
}

#[test]
fn a_struck_out_verification_stays_with_person_and_reason() {
    let (folder, mut store) = new_store();
    let all = [verified("scanner", 0.1), verified("scanner", 203.5)];
    all.iter().for_each(|verification| store.store_verification(verification).expect("kept"));
    drop(store);
    let folder = folder.path().join("store");
    let strike = Strike { by: "A. Smith".to_owned(), why: "mistyped board".to_owned(), at_unix_s: 9 };
    let (store, struck) = Store::strike_out_in(&folder, 2, &strike).expect("struck out");
    let expected = Verification { struck: Some(strike.clone()), ..all[1].clone() };
    assert_eq!(struck, expected);
    assert_eq!(store.verification_history().expect("read"), [(1, all[0].clone()), (2, expected.clone())]);
    assert_eq!(store.newest_verification("scanner").expect("read"), Some(expected), "no older one takes its place");
    drop(store);
    let refused = |number: i64| Store::strike_out_in(&folder, number, &strike).expect_err("refused").to_string();
    assert!(refused(2).contains("already struck out, by A. Smith"), "{}", refused(2));
    assert!(refused(3).contains("no verification 3"), "{}", refused(3));
    let elsewhere = folder.join("sotre");
    assert!(Store::strike_out_in(&elsewhere, 1, &strike).is_err() && !elsewhere.exists(), "no store is made");
}

#[test]
fn the_hash_depends_on_files_and_their_order() {
    let hash = calibration_hash(&["lens", "mount"]);
    assert_ne!(hash, calibration_hash(&["mount", "lens"]));
    assert_ne!(hash, calibration_hash(&["lensmount"]));
    assert_eq!(hash, calibration_hash(&["lens", "mount"]));
}
