//! Tests when alarms begin and end.

use super::*;
use panelprep_cell::record::{Answer, RequestRecord, RequestedAction};

fn reason(code: &'static str) -> Reason {
    Reason::new(code, format!("the words of {code}"))
}

fn gave(kind: Kind, codes: &[&'static str]) -> Finding {
    let reasons = codes.iter().map(|code| reason(code)).collect();
    Finding::new(kind, 0, Judgement { verdict: Verdict::Review, reasons })
}

/// Creates a cycle from 1,000 s to 1,090 s with these findings, which were stored every 10 s from 1,010 s on.
fn past(findings: Vec<Finding>, end: &[&'static str]) -> (CycleRecord, AlarmTimes) {
    let mut record = cycle(1, 0.06, &[], &[]).record;
    let times = (0..findings.len() as i64).map(|index| Some(1_010_000 + index * 10_000)).collect();
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

/// The overlap is too low in two scans and sufficient in the third, 20 s later; another phase does not end the
/// alarm.
#[test]
fn an_alarm_lasts_until_its_phase_no_longer_gives_it() {
    let findings = vec![
        gave(Kind::Locate, &["low_overlap"]),
        gave(Kind::Inspect, &["light"]),
        gave(Kind::Locate, &["low_overlap", "blurred"]),
        gave(Kind::Locate, &["blurred"]),
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

/// The reasons of the verdict last until a person resets the cell, 5 s after the end.
#[test]
fn the_reasons_of_the_verdict_last_beyond_the_end() {
    let (record, mut times) = past(vec![gave(Kind::Locate, &["no_panel", "blurred"])], &["no_panel", "stopped"]);
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
fn while_a_cycle_runs_its_alarms_last() {
    let (mut record, times) = past(vec![gave(Kind::Locate, &["low_overlap"])], &[]);
    (record.judgement, record.ended_unix_s) = (None, None);
    assert_eq!(summaries(&record, &times), [alarm("low_overlap", Some(Kind::Locate), 1_010_000, None)]);
}

/// An earlier program stored no times: its findings count from the begin of the cycle.
#[test]
fn findings_without_a_time_count_from_the_begin() {
    let (record, _) = past(vec![gave(Kind::Locate, &["low_overlap"])], &[]);
    let told = summaries(&record, &AlarmTimes::default());
    assert_eq!(told, [alarm("low_overlap", Some(Kind::Locate), 1_000_000, Some(1_090_000))]);
}

#[test]
fn a_refused_request_is_an_alarm_of_its_moment() {
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

/// The same code raised again is another alarm, which is not acknowledged yet.
#[test]
fn an_acknowledgement_is_of_one_raising() {
    let findings =
        vec![gave(Kind::Locate, &["low_overlap"]), gave(Kind::Locate, &[]), gave(Kind::Locate, &["low_overlap"])];
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
    let (unknown, times) = past(vec![gave(Kind::Locate, &["of_an_earlier_program"])], &[]);
    assert_eq!(alarms(&unknown, &times, &[])[0].priority, Priority::Medium, "what is not known is not overlooked");
    let table = alarm_table(&all).csv().expect("written");
    assert!(
        table.lines().nth(1).is_some_and(
            |line| line.starts_with("1970-01-01 00:16:50 UTC,1010000,1020000,medium,low_overlap,1,locate,")
        ),
        "{table}"
    );
}

/// Two films broke: the alarm lasts from the first one, and names what the second one found.
#[test]
fn an_alarm_that_lasts_states_what_was_found_last() {
    let mut findings = vec![gave(Kind::Inspect, &["broken"]), gave(Kind::Inspect, &["broken"])];
    findings[0].judgement.reasons[0].message = "r1c1 and r1c2 broke".to_owned();
    findings[1].judgement.reasons[0].message = "r1c2 broke".to_owned();
    let (record, times) = past(findings, &["broken"]);
    let all = alarms(&record, &times, &[]);
    let told: Vec<(i64, &str)> = all.iter().map(|alarm| (alarm.raised_unix_ms, &*alarm.message)).collect();
    assert_eq!(told, [(1_010_000, "r1c2 broke")]);
}
