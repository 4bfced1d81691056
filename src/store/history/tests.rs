//! Tests of the history of cycles, with expected values that were calculated by hand, and of the start and the end of
//! alarms.

use super::*;
use panelprep_base::verdict::{Check, Judgement, Limit, LimitSource, Reason, Verdict};
use panelprep_cell::record::{
    Answer, Budget, CycleId, CycleRecord, Finding, KeptFile, Kind, NO_PART, PartNames, RequestRecord,
    RequestedAction, name,
};
use std::collections::BTreeMap;

fn found(kind: Kind, pass: u8, verdict: Verdict) -> Finding {
    Finding::new(kind, pass, Judgement { verdict, reasons: vec![] })
}

/// Creates the finding of a film on 2 × 2 grids, with the failed grids and the time at which each failed.
fn film(pass: u8, failed: &[(&str, f64)]) -> Finding {
    let verdict = if failed.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let area = |grid: &str| if failed.iter().any(|(id, _)| *id == grid) { 50.0 } else { 0.0 };
    let grids = ["r1c1", "r1c2", "r2c1", "r2c2"].map(|grid| {
        Check::new(name::broken_film(grid), "mm²", area(grid)).with_limit(Limit::Below(5.0), LimitSource::Program)
    });
    let times = failed.iter().map(|(grid, s)| Check::new(name::break_time_name(grid), "s", *s));
    let names: Vec<&str> = failed.iter().map(|(grid, _)| *grid).collect();
    let light =
        |name: &'static str, percent: f64| Check::new(name, "%", percent).with_min(-40.0, LimitSource::Program);
    found(Kind::Inspect, pass, verdict)
        .with_checks([Check::new(name::WATCHED_TIME_NAME, "s", 60.0 + f64::from(pass))])
        .with_checks([light(name::LIGHT_MIN, if pass == 0 { -7.0 } else { -3.0 })])
        .with_checks(grids)
        .with_checks(times)
        .with_detail("failed", serde_json::json!(names))
}

fn located(residual_mm: f64) -> Finding {
    let check =
        Check::new(name::RESIDUAL, "mm", residual_mm).with_max(0.25, LimitSource::recipe("locate.max_rms_mm"));
    found(Kind::Locate, 0, Verdict::Accept).with_checks([check])
}

/// Creates a cycle that started at `id` × 1,000 s and lasted 90 s. The grids `first` failed in the first film; after a
/// sanding pass, only the grids `at_end` failed.
fn cycle(id: i64, residual_mm: f64, first: &[(&str, f64)], at_end: &[(&str, f64)]) -> PastCycle {
    let mut findings = vec![located(residual_mm), film(0, first)];
    if !first.is_empty() {
        let grids: Vec<&str> = first.iter().map(|(grid, _)| *grid).collect();
        findings.push(found(Kind::Abrade, 1, Verdict::Accept).with_detail("grids", serde_json::json!(grids)));
        findings.push(film(1, at_end));
    }
    let record = CycleRecord {
        id: CycleId(id),
        started_unix_s: id * 1_000,
        ended_unix_s: Some(id * 1_000 + 90),
        panel: "wing".to_owned(),
        taught_version: "v1".to_owned(),
        recipe_hash: "aa".to_owned(),
        files: vec![KeptFile { name: "scanner".to_owned(), hash: "cc".to_owned() }],
        program_version: "1".to_owned(),
        judgement: Some(Judgement { verdict: Verdict::Pass, reasons: vec![] }),
        budget: Some(Budget {
            hand_eye_mm: Some(0.3),
            locate_mm: Some(0.4),
            fit_mm: Some(0.0),
            robot_mm: Some(0.0),
            stated_mm: None,
        }),
        findings,
        motions: vec![],
        asked_before: vec![],
        asked: vec![],
        clocks: [None, None],
        recording: None,
        events: 0,
    };
    let part = PartNames { serial: Some("SN-1".to_owned()), ..PartNames::default() };
    PastCycle { record, part: Some(part), disc: Some(DiscWear { swept_mm2: 100.0 * id as f64, worn_mm2: 900.0 }) }
}

/// Expected values, calculated by hand: √(0.3² + 0.4²) = 0.5, and films of 60 s and 61 s.
#[test]
fn a_summary_contains_the_results_of_the_cycle() {
    let told = summary(&cycle(3, 0.06, &[("r1c2", 5.1), ("r2c1", 4.5)], &[("r2c1", 30.0)]));
    assert_eq!((told.cycle, told.cycle_time_s, told.passes), (CycleId(3), Some(90), 1));
    assert_eq!(told.localization_residual.and_then(|check| check.value), Some(0.06));
    assert_eq!(told.budget_total_mm, Some(0.5));
    let films = told.films;
    assert_eq!((films.valid, films.invalid, films.watched_s, films.grids), (2, 0, Some(121.0), 4));
    assert_eq!(films.failed_first, Some(vec!["r1c2".to_owned(), "r2c1".to_owned()]));
    assert_eq!(films.failed_at_end, Some(vec!["r2c1".to_owned()]));
}

/// An invalid film has no result, so the next film is treated as the first one.
#[test]
fn an_invalid_film_is_counted_but_gives_no_result() {
    let mut past = cycle(1, 0.06, &[], &[]);
    let mut invalid = film(0, &[("r1c1", 1.0)]);
    invalid.judgement.verdict = Verdict::Invalid;
    past.record.findings.insert(1, invalid);
    let films = summary(&past).films;
    assert_eq!((films.valid, films.invalid, films.failed_first), (1, 1, Some(vec![])));
    assert_eq!(heat_map(&[past]).grids[0].breaks, 0);
}

#[test]
fn two_cycles_are_compared_check_by_check_and_grid_by_grid() {
    let first = cycle(1, 0.06, &[("r1c2", 5.1)], &[]);
    let mut second = cycle(2, 0.09, &[("r2c1", 4.5)], &[("r2c1", 9.0)]);
    second.record.recipe_hash = "bb".to_owned();
    second.record.files.push(KeptFile { name: "robot_correction".to_owned(), hash: "dd".to_owned() });
    let reported = compare(&first, &second);
    assert_eq!(reported.is_same_part, Some(true));
    let differs: Vec<&str> = reported.inputs.iter().filter(|it| !it.is_same).map(|it| it.name.as_str()).collect();
    assert_eq!(differs, ["recipe", "robot_correction"]);
    let residual = reported.checks.iter().find(|pair| pair.name == name::RESIDUAL).expect("compared");
    assert_eq!(residual.values, [Some(0.06), Some(0.09)]);
    // The difference 0.09 − 0.06 is 0.03 within the rounding error.
    assert!(residual.difference.is_some_and(|mm| (mm - 0.03).abs() < 1e-15) && !residual.is_limit_different());
    let only =
        reported.checks.iter().find(|pair| pair.pass == 1 && pair.name == "r2c1 failed after").expect("compared");
    assert_eq!((only.values, only.difference), ([None, Some(9.0)], None));
    let grid = |id: &str| reported.grids.iter().find(|pair| pair.grid == id).expect("compared").clone();
    let words = grid("r1c2").cycles.map(|past| past.map(|past| past.describe()).unwrap_or_default());
    assert_eq!(
        words,
        [
            "failed in the first film after 5.1 s, abraded once, passed in the last film",
            "passed in the first film, passed in the last film"
        ]
    );
    assert_eq!(
        reported.grids.iter().map(|pair| pair.grid.as_str()).collect::<Vec<_>>(),
        ["r1c1", "r1c2", "r2c1", "r2c2"]
    );
}

/// Expected values, calculated by hand: r1c2 broke after 4, 10 and 6 s, so the median is 6 s; r2c1 broke after 3 and 8
/// s, so the median is 5.5 s.
#[test]
fn the_heat_map_counts_first_films() {
    let cycles = [
        cycle(1, 0.06, &[("r1c2", 4.0), ("r2c1", 3.0)], &[("r2c2", 1.0)]),
        cycle(2, 0.06, &[("r1c2", 10.0)], &[]),
        cycle(3, 0.06, &[("r1c2", 6.0), ("r2c1", 8.0)], &[]),
        cycle(4, 0.06, &[], &[]),
    ];
    let map = heat_map(&cycles);
    let told: BTreeMap<&str, (usize, usize, Option<f64>)> =
        map.grids.iter().map(|cell| (cell.grid.as_str(), (cell.films, cell.breaks, cell.median_s))).collect();
    assert_eq!(map.films, 4);
    assert_eq!(told["r1c2"], (4, 3, Some(6.0)));
    assert_eq!(told["r2c1"], (4, 2, Some(5.5)));
    assert_eq!(told["r2c2"], (4, 0, None), "the last film is not the first");
    assert_eq!((map.grids[3].row, map.grids[3].column), (2, 2));
}

/// Twelve residuals alternate between 0.05 and 0.06, and the next one is 0.20. The standard deviation is about 0.02 /
/// 1.128, so that 0.20 is far outside.
#[test]
fn a_trend_has_its_limits_and_hints() {
    let mut cycles: Vec<PastCycle> =
        (1..=12).map(|id| cycle(id, if id % 2 == 0 { 0.05 } else { 0.06 }, &[], &[])).collect();
    cycles.push(cycle(13, 0.20, &[("r1c1", 7.5), ("r2c2", 2.5)], &[]));
    let told = trend(&Quantity::from_keyword("localization-residual"), &cycles);
    assert_eq!((told.points.len(), told.unit.as_str(), told.without), (13, "mm", 0));
    assert_eq!(told.points[12].limit, Limit::AtMost(0.25));
    let beyond = told.hints.iter().filter(|hint| hint.rule == western_electric::Rule::OneBeyondThree);
    assert_eq!(beyond.map(|hint| hint.at).collect::<Vec<_>>(), [12], "within its limit, and yet unusual");
    let value =
        |quantity: &str| trend(&Quantity::from_keyword(quantity), &cycles).points.last().map(|point| point.value);
    assert_eq!(value("time-to-break"), Some(2.5));
    assert_eq!(value("passes"), Some(1.0));
    assert_eq!(value("light-least"), Some(-7.0), "of two films the one with less light");
    assert_eq!(value("disc-swept"), Some(1_300.0));
    assert_eq!(value("cycle-time"), Some(90.0));
    assert_eq!(value("error-at-tool"), Some(0.5));
    assert_eq!(value("broken film in r2c1"), Some(0.0), "a check by its name");
    assert_eq!(value("no such thing"), None);
    assert_eq!(trend(&Quantity::from_keyword("time-to-break"), &cycles).without, 12);
}

#[test]
fn every_quantity_has_a_keyword() {
    for word in KnownQuantity::keywords() {
        assert!(
            matches!(Quantity::from_keyword(word), Quantity::Known(known) if known.keyword() == word),
            "{word}"
        );
    }
    assert_eq!(KnownQuantity::keywords().len(), 21);
}

/// The CSV writer checks that each row has one cell for each column.
#[test]
fn all_results_can_be_written_as_tables() {
    let cycles = [cycle(1, 0.06, &[("r1c2", 5.1)], &[]), cycle(2, 0.06, &[], &[])];
    let reported = cycles.each_ref().map(summary);
    let text = summary_table(&reported).csv().expect("written");
    let rows: Vec<&str> = text.lines().collect();
    assert!(rows[0].starts_with("cycle,started_utc,") && rows[0].contains(",localization_residual_mm,"));
    assert!(
        rows[1].starts_with(
            "1,1970-01-01 00:16:40 UTC,1000,1090,wing,SN-1,,,pass,false,,1,2,0,121,4,r1c2,,0.06,0.25,"
        ),
        "{}",
        rows[1]
    );
    let compared = comparison_table(&compare(&cycles[0], &cycles[1])).csv().expect("written");
    assert!(
        compared
            .contains("check,locate,0,\"residual, point to plane, rms\",mm,0.06,0.06,0,at most 0.25,at most 0.25"),
        "{compared}"
    );
    assert!(compared.contains("input,,,recipe,,aa,aa,same,,"), "{compared}");
    let heat = heat_table(&heat_map(&cycles)).csv().expect("written");
    assert!(heat.contains("r1c2,1,2,2,1,5.1"), "{heat}");
    let hit = Hit {
        cycle: CycleId(7),
        started_unix_s: 0,
        ended_unix_s: None,
        panel: "wing".to_owned(),
        part: PartNames::default(),
        verdict: None,
        is_air_run: true,
        reasons: vec![Reason::new("a_b", "words"), Reason::new("c", "more")],
    };
    assert!(
        hits_table(&[hit])
            .csv()
            .expect("written")
            .contains("7,1970-01-01 00:00:00 UTC,0,,wing,,,,,true,a_b c,words; more")
    );
    let trend = trend_table(&trend(&Quantity::from_keyword("passes"), &cycles)).csv().expect("written");
    assert!(trend.starts_with("cycle,at_utc,at_unix_s,serial,value,limit,hints\r\n1,"), "{trend}");
}

/// A panel that was taught again may have another region, so that the same grid name means another place.
#[test]
fn the_heat_map_counts_one_taught_panel_only() {
    let mut cycles = [cycle(1, 0.05, &[("r1c1", 4.0)], &[]), cycle(2, 0.05, &[("r1c2", 4.0)], &[])];
    assert_eq!(heat_map(&cycles).films, 2);
    cycles[1].record.taught_version = "v2".to_owned();
    let map = heat_map(&cycles);
    let breaks: Vec<(&str, usize)> = map.grids.iter().map(|cell| (&*cell.grid, cell.breaks)).collect();
    assert_eq!((map.films, breaks), (1, vec![("r1c1", 0), ("r1c2", 1), ("r2c1", 0), ("r2c2", 0)]));
}

/// Expected values, calculated by hand: the second pass was interrupted after 4 reported and 16 permitted waypoints. So
/// the tool has touched r1c1 (first waypoint 2), may have touched r2c1 (10), and has not touched r2c2 (30). The film
/// before this pass is no longer valid.
#[test]
fn an_interrupted_pass_leaves_possibly_touched_grids() {
    use panelprep_cell::cycle::{Id, Motion, Path};
    use panelprep_cell::record::{Contact, ContactPath, FirstReached, MotionRecord};
    let mut record = cycle(1, 0.05, &[("r1c1", 4.0)], &[("r1c1", 5.0)]).record;
    assert!(touched_grids(&record).is_empty() && touching_passes(&record) == 1);
    let reached = |(grid, first): (&str, u32)| FirstReached { grid: grid.to_owned(), first };
    let grids = [("r1c1", 2), ("r2c1", 10), ("r2c2", 30)].map(reached).into();
    let path = ContactPath { id: Id(9), pass: 2, grids, wears_mm2: 100.0 };
    record.motions.push(MotionRecord {
        motion: Motion { epoch: 3, path: Path::Contact, plan: 7, waypoints: 40 },
        outcome: None,
        done: 0,
        contact: Some(Contact { path, told: 4, permitted: 16 }),
    });
    assert_eq!(touched_grids(&record).into_iter().collect::<Vec<_>>(), ["r1c1", "r2c1"]);
    assert_eq!(touching_passes(&record), 2);
}

/// The object in the cell was not the part, so its residual is not a value of the panel.
#[test]
fn a_cycle_without_a_part_is_not_in_a_trend() {
    let mut cycles = vec![cycle(1, 0.1, &[], &[]), cycle(2, 9.0, &[], &[])];
    let values = |cycles: &[PastCycle]| -> (Vec<f64>, usize) {
        let trend = trend(&Quantity::from_keyword("localization-residual"), cycles);
        (trend.points.iter().map(|point| point.value).collect(), trend.without)
    };
    assert_eq!(values(&cycles), (vec![0.1, 9.0], 0));
    let reasons = vec![Reason::new(NO_PART, "another object"), Reason::new("poor_fit", "9 mm")];
    cycles[1].record.judgement = Some(Judgement { verdict: Verdict::Reject, reasons });
    assert_eq!(values(&cycles), (vec![0.1], 0));
}

fn reason(code: &'static str) -> Reason {
    Reason::new(code, format!("the words of {code}"))
}

fn with_reasons(kind: Kind, codes: &[&'static str]) -> Finding {
    let reasons = codes.iter().map(|code| reason(code)).collect();
    Finding::new(kind, 0, Judgement { verdict: Verdict::Review, reasons })
}

/// Creates a cycle from 1,000 s to 1,090 s. Its findings were stored at intervals of 10 s from 1,010 s on.
fn past(findings: Vec<Finding>, end: &[&'static str]) -> (CycleRecord, AlarmTimes) {
    let mut record = cycle(1, 0.06, &[], &[]).record;
    let times = (0..findings.len() as i64).map(|index| 1_010_000 + index * 10_000).collect();
    record.findings = findings;
    record.judgement =
        Some(Judgement { verdict: Verdict::Reject, reasons: end.iter().map(|code| reason(code)).collect() });
    (record, AlarmTimes { findings_unix_ms: times, settled_unix_ms: None })
}

type AlarmSummary = (String, Option<Kind>, i64, Option<i64>);

fn summaries(record: &CycleRecord, times: &AlarmTimes) -> Vec<AlarmSummary> {
    let all = alarms(record, times, &[]).into_iter();
    all.map(|alarm| (alarm.code, alarm.phase, alarm.raised_unix_ms, alarm.gone_unix_ms)).collect()
}

fn alarm(code: &str, phase: Option<Kind>, raised: i64, gone: Option<i64>) -> AlarmSummary {
    (code.to_owned(), phase, raised, gone)
}

/// The overlap is too low in two scans, and sufficient in the third one, 20 s later. A finding of another phase does
/// not end the alarm.
#[test]
fn an_alarm_lasts_until_its_phase_no_longer_gives_the_reason() {
    let findings = vec![
        with_reasons(Kind::Locate, &["low_overlap"]),
        with_reasons(Kind::Inspect, &["light"]),
        with_reasons(Kind::Locate, &["low_overlap", "blurred"]),
        with_reasons(Kind::Locate, &["blurred"]),
    ];
    let (record, times) = past(findings, &[]);
    assert_eq!(
        summaries(&record, &times),
        [
            alarm("low_overlap", Some(Kind::Locate), 1_010_000, Some(1_040_000)),
            alarm("light", Some(Kind::Inspect), 1_020_000, Some(1_090_000)),
            alarm("blurred", Some(Kind::Locate), 1_030_000, Some(1_090_000)),
        ]
    );
}

/// Alarms for the reasons of the verdict stay active until a person resets the cell, 5 s after the end.
#[test]
fn alarms_of_the_verdict_last_beyond_the_end_of_the_cycle() {
    let (record, mut times) =
        past(vec![with_reasons(Kind::Locate, &["no_panel", "blurred"])], &["no_panel", "stopped"]);
    let lasting = summaries(&record, &times);
    assert_eq!(
        lasting,
        [
            alarm("no_panel", Some(Kind::Locate), 1_010_000, None),
            alarm("blurred", Some(Kind::Locate), 1_010_000, Some(1_090_000)),
            alarm("stopped", None, 1_090_000, None),
        ],
        "each code once"
    );
    times.settled_unix_ms = Some(1_095_000);
    let gone: Vec<Option<i64>> = summaries(&record, &times).into_iter().map(|told| told.3).collect();
    assert_eq!(gone, [Some(1_095_000), Some(1_090_000), Some(1_095_000)]);
}

#[test]
fn the_alarms_of_a_running_cycle_last() {
    let (mut record, times) = past(vec![with_reasons(Kind::Locate, &["low_overlap"])], &[]);
    (record.judgement, record.ended_unix_s) = (None, None);
    assert_eq!(summaries(&record, &times), [alarm("low_overlap", Some(Kind::Locate), 1_010_000, None)]);
}

#[test]
fn a_refused_request_is_an_alarm_that_ends_immediately() {
    let (mut record, times) = past(vec![], &[]);
    let asked = |answer, code| RequestRecord {
        unix_ms: 1_020_500,
        wanted: RequestedAction::NewDisc,
        who: None,
        answer: Some(answer),
        reasons: vec![reason(code)],
        findings: None,
    };
    record.asked = vec![asked(Answer::Refused, "not_now"), asked(Answer::Done, "not_told")];
    assert_eq!(summaries(&record, &times), [alarm("not_now", None, 1_020_500, Some(1_020_500))]);
}

/// If the same code is raised again, it is another alarm, which is not acknowledged yet.
#[test]
fn an_acknowledgement_applies_to_one_alarm() {
    let findings = vec![
        with_reasons(Kind::Locate, &["low_overlap"]),
        with_reasons(Kind::Locate, &[]),
        with_reasons(Kind::Locate, &["low_overlap"]),
    ];
    let (record, times) = past(findings, &[]);
    let seen = |raised_unix_ms, who: &str| Acknowledgement {
        unix_ms: 2_000_000,
        cycle: Some(CycleId(1)),
        code: "low_overlap".to_owned(),
        raised_unix_ms,
        who: who.to_owned(),
    };
    let all = alarms(&record, &times, &[seen(1_010_000, "Ada"), seen(1_010_000, "Grace")]);
    let who: Vec<Option<String>> =
        all.iter().map(|alarm| alarm.acknowledged.as_ref().map(|seen| seen.who.clone())).collect();
    assert_eq!(who, [Some("Ada".to_owned()), None]);
    assert!(all[0].cause.contains("overlap") || all[0].cause.contains("partner"), "{}", all[0].cause);
    assert_eq!((all[0].priority, all[0].is_active()), (Priority::Medium, false));
    let (unknown, times) = past(vec![with_reasons(Kind::Locate, &["of_an_earlier_program"])], &[]);
    assert_eq!(alarms(&unknown, &times, &[])[0].priority, Priority::Medium, "what is not known is not overlooked");
    let table = alarm_table(&all).csv().expect("written");
    assert!(
        table.lines().nth(1).is_some_and(
            |line| line.starts_with("1970-01-01 00:16:50 UTC,1010000,1020000,medium,low_overlap,1,locate,")
        ),
        "{table}"
    );
}

/// Two films broke: the alarm is active from the first one, and has the message of the second one.
#[test]
fn an_active_alarm_has_the_message_of_the_last_finding() {
    let mut findings = vec![with_reasons(Kind::Inspect, &["broken"]), with_reasons(Kind::Inspect, &["broken"])];
    findings[0].judgement.reasons[0].message = "r1c1 and r1c2 broke".to_owned();
    findings[1].judgement.reasons[0].message = "r1c2 broke".to_owned();
    let (record, times) = past(findings, &["broken"]);
    let all = alarms(&record, &times, &[]);
    let told: Vec<(i64, &str)> = all.iter().map(|alarm| (alarm.raised_unix_ms, &*alarm.message)).collect();
    assert_eq!(told, [(1_010_000, "r1c2 broke")]);
}
