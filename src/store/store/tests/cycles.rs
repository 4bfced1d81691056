//! The record of a cycle is complete.

use super::*;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Event, Motion, Outcome, Path as MotionPath, Request};
use panelprep_cell::record::{
    Budget, Check, CycleId, Finding, KeptFile, Kind, Limit, LimitSource, MotionRecord, Picture, RequestedAction,
};
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
fn a_cycle_is_restored_completely_and_to_the_bit() {
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
    // The bytes of the inputs are found by the record alone.
    assert_eq!(store.blob(&record.recipe_hash).expect("kept"), start().recipe_text.as_bytes());
    let files: Vec<_> =
        record.files.iter().map(|file| (file.name.as_str(), store.blob(&file.hash).expect("kept"))).collect();
    assert_eq!(files, [("cell", b"[limits]\n".to_vec()), ("scanner", b"fx_px = 1\n".to_vec())]);
    assert_eq!(store.newest_cycle().expect("read"), Some(id));
}

#[test]
fn what_does_not_fit_is_refused() {
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
