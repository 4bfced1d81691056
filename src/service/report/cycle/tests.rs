use super::*;
use panelprep_cell::cycle::{Id, Motion, Outcome, Path, Request};
use panelprep_cell::record::{
    Answer, Budget, Contact, ContactPath, CycleId, FirstReached, KeptFile, Limit, LimitSource, MotionRecord,
    Picture, RequestAuthor, RequestRecord, RequestSource, RequestedAction,
};

fn finding(kind: Kind, pass: u8, numbers: Vec<Check>) -> Finding {
    let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
    Finding::new(kind, pass, judgement).with_checks(numbers)
}

fn asked(wanted: RequestedAction, answer: Option<Answer>) -> RequestRecord {
    let who = RequestAuthor {
        uid: Some(1_000),
        user: Some("ada".to_owned()),
        ..RequestAuthor::from_source(RequestSource::Socket)
    };
    let reasons = match answer {
        Some(Answer::Refused) => vec![Reason::new("not_now", "it is not held")],
        _ => vec![],
    };
    RequestRecord { unix_ms: 1_700_000_030_999, wanted, who: Some(who), answer, reasons, findings: None }
}

fn record() -> CycleRecord {
    let rms = Check::new("residual", "mm", 0.123456).with_limit(Limit::AtMost(0.25), LimitSource::Program);
    let overlap = Check::new("overlap", "", 0.85).with_limit(Limit::AtLeast(0.9), LimitSource::Program);
    let mut located = finding(Kind::Locate, 0, vec![rms, overlap, Check::new("drift", "mm", None)]);
    let pose = KukaPose { x_mm: 1.5, a_deg: -3.0, ..KukaPose::default() };
    located.details.insert("base_from_panel".to_owned(), serde_json::json!(pose));
    located.shots.push(KeptFile { name: "scan".to_owned(), hash: "f00d".to_owned() });
    let picture = |caption: &str, hash: &str| Picture {
        name: "located".to_owned(),
        caption: caption.to_owned(),
        hash: hash.to_owned(),
    };
    located.pictures = vec![picture("outline", "aa"), picture("grids", "bb")];
    let watched = |seconds: f64| vec![Check::new(name::WATCHED_TIME_NAME, "s", seconds)];
    let part = finding(Kind::Abrade, 2, vec![])
        .with_detail("grids", vec!["r1c1"])
        .with_detail("grids_in_part", vec!["r2c4"]);
    let motion = Motion { epoch: 3, path: Path::Contact, plan: 0xAB, waypoints: 200 };
    CycleRecord {
        id: CycleId(7),
        started_unix_s: 1_700_000_000,
        ended_unix_s: Some(1_700_000_090),
        panel: "wing <2>".to_owned(),
        taught_version: "0123".to_owned(),
        recipe_hash: "cafe".to_owned(),
        files: vec![KeptFile { name: "base_from_camera".to_owned(), hash: "beef".to_owned() }],
        program_version: "0.1.0".to_owned(),
        judgement: Some(Judgement { verdict: Verdict::Pass, reasons: vec![] }),
        budget: Some(Budget { locate_mm: Some(0.15), stated_mm: Some(0.8), ..Budget::default() }),
        findings: vec![
            located,
            finding(Kind::Inspect, 0, watched(60.0)),
            finding(Kind::Abrade, 1, vec![]).with_detail("grids", vec!["r1c1"]),
            part,
            finding(Kind::Inspect, 1, watched(59.8)),
        ],
        asked_before: vec![asked(RequestedAction::NewDisc, Some(Answer::Done))],
        asked: vec![
            asked(RequestedAction::For(Request::Accept), Some(Answer::Refused)),
            asked(RequestedAction::For(Request::Accept), Some(Answer::Done)),
            RequestRecord { who: None, ..asked(RequestedAction::For(Request::Hold), None) },
        ],
        clocks: [Some(Clock::Wall), Some(Clock::Wall)],
        recording: None,
        motions: vec![MotionRecord { motion, outcome: Some(Outcome::Done), done: 200, contact: None }],
        events: 321,
    }
}

#[test]
fn the_page_shows_every_number_limit_and_hash() {
    let pictures = BTreeMap::from([("aa".to_owned(), vec![1, 2, 3])]);
    let html = cycle_page(&record(), &pictures).html();
    for part in [
        "<h1>Panel wing &lt;2&gt;, cycle 7</h1>",
        "Wall time: 2023-11-14 22:13:20 UTC to 2023-11-14 22:14:50 UTC, 90 s.</p>",
        "class=\"verdict good\"><b>pass</b>",
        "<td>residual</td><td>0.1235 mm</td><td>≤ 0.25 mm</td>",
        "<td>overlap</td><td>0.85, outside of the limit</td><td>≥ 0.9</td>",
        "<td>drift</td><td>not measured</td>",
        "<td>base_from_panel</td><td>X 1.500 Y 0.000 Z 0.000 mm, A -3.0000 B 0.0000 C 0.0000°</td>",
        "<td>picture scan</td><td>f00d</td>",
        "<td>r1c1</td><td>pass 1; pass 2</td>",
        "<td>r2c4</td><td>pass 2 in part</td>",
        "<td>2023-11-14 22:13:50 UTC</td><td>REFUSED: accept. Nothing was done: it is not held. Requested by: ada (user 1000), through",
        "<td>accept: done, the result that waited for review was accepted. Requested by: ada",
        "<td>hold: its result was not recorded. Requested by: not recorded</td>",
        "<h2>Requests before this cycle</h2>",
        "<td>new-disc: done, a new disc was mounted",
        "data:image/jpeg;base64,AQID",
        "<td>grids</td><td>the picture bb is missing</td>",
        "<td>contact, epoch 3, plan 00000000000000ab</td><td>done, 200 of 200 waypoints</td>",
        "<td>hand-eye calibration</td><td>not measured</td>",
        "<td>localization</td><td>0.15 mm</td>",
        "<td>total</td><td>not measured</td>",
        "0.8 mm, from the cell&#39;s file, not measured",
        "<td>recipe</td><td>cafe</td>",
        "<td>base_from_camera</td><td>beef</td>",
        "<td>film watched first</td><td>60 s</td>",
        "<td>film watched after pass 1</td><td>59.8 s</td>",
        "<h2>Water, lamp and films</h2>",
    ] {
        let part = part.replace("&#39;", "'");
        assert!(html.contains(&part), "no {part} in\n{html}");
    }
    assert!(!html.contains("http"), "nothing is fetched");
}

#[test]
fn a_complete_budget_has_a_total_and_a_running_cycle_no_result() {
    let part = Some(0.5);
    let whole = Budget { hand_eye_mm: part, locate_mm: part, fit_mm: part, robot_mm: part, stated_mm: Some(0.8) };
    let html = cycle_page(
        &CycleRecord { budget: Some(whole), judgement: None, ended_unix_s: None, ..record() },
        &BTreeMap::new(),
    )
    .html();
    // Expected value, calculated by hand: √(4 · 0.5²) = 1.
    assert!(html.contains("<td>total</td><td>1 mm</td>") && !html.contains("tool_error_mm"));
    assert!(html.contains("class=\"verdict doubt\"") && html.contains("not ended"));
    assert!(html.contains("<td>robot and tool</td>"));
    let mut corrected = record();
    corrected.files.push(KeptFile { name: "robot_correction".to_owned(), hash: "f00d".to_owned() });
    let html = cycle_page(&corrected, &BTreeMap::new()).html();
    assert!(html.contains("<td>robot, corrected by robot_correction, and tool</td>") && html.contains("f00d"));
}

#[test]
fn numbers_have_four_significant_digits() {
    let texts = [0.123456, 59.8, 123456.7, 0.00012344, -2.5, 0.0, 100.04, 3.0].map(format_value);
    assert_eq!(texts, ["0.1235", "59.8", "123457", "0.0001234", "-2.5", "0", "100", "3"]);
}

/// Returns a cycle with a contact path whose end was not reported: the robot reported 3 waypoints, and 16 were
/// permitted. The path reaches r1c1 at waypoint 2, r1c2 at 10 and r1c3 at 30.
fn cycle_with_an_interrupted_path() -> CycleRecord {
    let reached = |grid: &str, first| FirstReached { grid: grid.to_owned(), first };
    let grids = vec![reached("r1c1", 2), reached("r1c2", 10), reached("r1c3", 30)];
    let path = ContactPath { id: Id(5), pass: 1, grids, wears_mm2: 1_234.0 };
    let motion = Motion { epoch: 3, path: Path::Contact, plan: 0xAB, waypoints: 101 };
    let contact = Some(Contact { path, told: 3, permitted: 16 });
    let motions = vec![MotionRecord { motion, outcome: None, done: 0, contact }];
    let findings = vec![finding(Kind::Inspect, 0, vec![Check::new(name::WATCHED_TIME_NAME, "s", 61.4)])];
    CycleRecord { motions, findings, ..record() }
}

#[test]
fn unknown_facts_about_a_contact_are_stated_as_unknown() {
    for outcome in [None, Some(Outcome::Cleared)] {
        let mut record = cycle_with_an_interrupted_path();
        record.motions[0].outcome = outcome;
        let html = cycle_page(&record, &BTreeMap::new()).html();
        for part in [
            "<td>r1c1</td><td>pass 1: touched, extent unknown</td>",
            "<td>r1c2</td><td>pass 1: possibly touched, not confirmed</td>",
            "the end of the motion is unknown: at least 3 and at most 16 of 101 waypoints were executed",
            "is counted as sanded for max_passes_per_grid",
            "includes the whole interrupted path, 1234 mm²",
        ] {
            assert!(html.contains(part), "{outcome:?}: no {part} in\n{html}");
        }
        assert!(!html.contains("touched no grid") && !html.contains("<td>r1c3</td>"), "{html}");
    }
    let mut unkept = cycle_with_an_interrupted_path();
    unkept.motions[0].contact = None;
    let html = cycle_page(&unkept, &BTreeMap::new()).html();
    assert!(
        html.contains("any grid (it was not recorded which grids)") && !html.contains("touched no grid"),
        "{html}"
    );
}

#[test]
fn simulated_time_and_wall_time_are_distinguished() {
    let simulated = |ms: u64| Some(Clock::Simulated { at_ms: ms });
    let mut record =
        CycleRecord { clocks: [simulated(500), simulated(192_700)], ..cycle_with_an_interrupted_path() };
    record.findings[0]
        .checks
        .extend([Check::new(name::SCAN_TO_VERDICT, "ms", 136.0), Check::new("residual", "mm", 0.1)]);
    record.findings.push(finding(Kind::Plan, 1, vec![Check::new("time at the recipe's feed", "s", 12.5)]));
    let html = cycle_page(&record, &BTreeMap::new()).html();
    for part in [
        "Simulated time: 192.2 s. Wall time: 2023-11-14 22:13:20 UTC to 2023-11-14 22:14:50 UTC, 90 s.",
        "<td>film watched first</td><td>61.4 s of simulated time</td>",
        "<td>scan to verdict</td><td>136 ms of wall time</td>",
        "<td>time at the recipe's feed</td><td>12.5 s, planned</td>",
        "<td>residual</td><td>0.1 mm</td>",
    ] {
        assert!(html.contains(part), "no {part} in\n{html}");
    }
    let real = CycleRecord { clocks: [Some(Clock::Wall), Some(Clock::Wall)], ..record.clone() };
    assert!(!cycle_page(&real, &BTreeMap::new()).html().contains("imulated"), "a real cell has one time");
    let earlier = CycleRecord { clocks: [None, None], ..record };
    assert!(cycle_page(&earlier, &BTreeMap::new()).html().contains("was not recorded"));
}

/// Expected counts, by hand: 101 of the 102 waypoints belong to the path, and all of them are executed; the approach
/// ends at the first waypoint.
#[test]
fn planned_and_executed_waypoints_are_counted_alike() {
    let executed = Check::new(name::EXECUTED_WAYPOINTS_NAME, "", 101.0)
        .with_limit(Limit::AtLeast(101.0), LimitSource::Program);
    let findings = vec![
        finding(Kind::Plan, 1, vec![Check::new(name::PLANNED, "", 102.0)]),
        finding(Kind::Abrade, 1, vec![executed]),
    ];
    let html = cycle_page(&CycleRecord { findings, ..record() }, &BTreeMap::new()).html();
    for part in [
        "<td>waypoints</td><td>102</td>",
        "<td>of these, of the path over the panel</td><td>101: all but the first waypoint, which is in air at the end of the approach</td>",
        "<td>waypoints executed</td><td>101</td><td>≥ 101</td>",
    ] {
        assert!(html.contains(part), "no {part} in\n{html}");
    }
}

#[test]
fn a_number_beyond_its_limit_is_printed_differently_from_it() {
    let shown = |value: f64, limit: Limit| {
        let row = row(
            &Check::new("n", "%", value).with_limit(limit, LimitSource::Program),
            Kind::Locate,
            ClockKind::Wall,
        );
        [row.value, row.allowed]
    };
    assert_eq!(shown(8.000_4, Limit::AtMost(8.0)), ["8.0004 %, outside of the limit", "≤ 8 %"]);
    assert_eq!(shown(0.249_999, Limit::AtLeast(0.25)), ["0.249999 %, outside of the limit", "≥ 0.25 %"]);
    assert_eq!(shown(8.2, Limit::AtMost(8.0)), ["8.2 %, outside of the limit", "≤ 8 %"]);
    assert_eq!(shown(-0.0, Limit::AtMost(8.0)), ["0 %", "≤ 8 %"]);
}

/// The verdict of a cycle on foam applies to the cell: its page states that it releases no panel.
#[test]
fn the_page_of_a_cycle_on_foam_releases_nothing() {
    let mut cycle = record();
    cycle.files.push(KeptFile { name: panelprep_cell::record::ON_FOAM.to_owned(), hash: "0".repeat(64) });
    let html = cycle_page(&cycle, &BTreeMap::new()).html();
    assert!(html.contains("cycle 7, on foam</h1>") && html.contains("releases no panel"), "{html}");
}

/// The verdict of an air-run states that the motions passed, not that the panel passed: its page states this, and
/// contains no test conditions.
#[test]
fn the_page_of_an_air_run_releases_nothing() {
    let cycle = record();
    assert!(!cycle_page(&cycle, &BTreeMap::new()).html().contains("air-run"));
    let asked_for = CycleRecord {
        asked: vec![asked(RequestedAction::For(Request::AirRun { max_moves: 3 }), Some(Answer::Done))],
        ..cycle.clone()
    };
    let mut flown = cycle.clone();
    flown.motions[0].motion.path = Path::Air;
    for page in [asked_for, flown] {
        let html = cycle_page(&page, &BTreeMap::new()).html();
        assert!(html.contains("cycle 7, air-run</h1>") && html.contains("neither tested nor sanded"), "{html}");
        assert!(!html.contains("<h2>Water, lamp and films</h2>"), "{html}");
    }
    let refused = asked(RequestedAction::For(Request::AirRun { max_moves: 3 }), Some(Answer::Refused));
    let page = cycle_page(&CycleRecord { asked: vec![refused], ..cycle }, &BTreeMap::new());
    assert!(page.html().contains("<h2>Water, lamp and films</h2>"));
}
