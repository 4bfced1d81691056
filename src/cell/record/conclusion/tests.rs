use super::*;
use crate::record::{LimitSource, RequestAuthor, RequestSource};
use proptest::prelude::*;

fn finding(kind: Kind, verdict: Verdict, code: &'static str) -> Finding {
    let reasons = match verdict {
        Verdict::Accept | Verdict::Pass => vec![],
        _ => vec![Reason::new(code, format!("{code} is not as it must be"))],
    };
    Finding::new(kind, 1, Judgement { verdict, reasons })
}

fn asked(request: Request, answer: Answer, findings: u64) -> RequestRecord {
    let (wanted, who) = (RequestedAction::For(request), Some(RequestAuthor::from_source(RequestSource::Socket)));
    RequestRecord { unix_ms: 7, wanted, who, answer: Some(answer), reasons: vec![], findings: Some(findings) }
}

fn codes(judgement: &Judgement) -> Vec<&str> {
    judgement.reasons.iter().map(|reason| &*reason.code).collect()
}

/// Returns the usual findings of a cycle that ends with pass: a broken film, a sanding pass, a film without a break.
fn passed() -> Vec<Finding> {
    let fail = finding(Kind::Inspect, Verdict::Fail, "broke");
    let good = |kind| finding(kind, Verdict::Accept, "");
    vec![good(Kind::Locate), fail, good(Kind::Plan), good(Kind::Abrade), finding(Kind::Inspect, Verdict::Pass, "")]
}

#[test]
fn a_film_that_failed_is_superseded_by_an_abrasion_and_a_later_film() {
    let all = passed();
    let judgement = conclude(Verdict::Pass, &all, &[], &[]);
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Pass, vec![]));
    assert_eq!(finding_dispositions(&all, &[])[1], Disposition::Superseded);
    // Without the sanding pass, without the later film, or with these two in reverse order, the first film is still
    // effective.
    for left_out in [3, 4] {
        let mut less = passed();
        less.remove(left_out);
        let judgement = conclude(Verdict::Pass, &less, &[], &[]);
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Fail, vec!["broke"]), "{left_out}");
    }
    let mut exchanged = passed();
    exchanged.swap(3, 4);
    assert_eq!(conclude(Verdict::Pass, &exchanged, &[], &[]).verdict, Verdict::Fail);
}

/// An empty cell or another object is not a nonconformance of a part. A part that differs in only one respect is a
/// nonconformance, and so is a part that was already tested or sanded in the cycle.
#[test]
fn a_cycle_that_found_nothing_or_another_object_examined_no_part() {
    let doubtful = |code: &str| ["points_missing", "blurred", "marks_differ"].contains(&code);
    let located_with = |given: &[&'static str], doubtful: &dyn Fn(&str) -> bool| {
        let check = |code: &&'static str| {
            let severity = if doubtful(code) { Severity::Review } else { Severity::Reject };
            let limit = Check::new(*code, "mm", 2.0).with_max(1.0, LimitSource::Program);
            limit.with_consequence(severity, code, || "as measured".to_owned())
        };
        let checks: Vec<Check> = given.iter().map(check).collect();
        Finding::new(Kind::Locate, 0, Judgement::from_checks(&checks)).with_checks(checks)
    };
    let located = |given: &[&'static str]| located_with(given, &doubtful);
    let concluded = |findings: &[Finding]| conclude(Verdict::Reject, findings, &[], &[]);
    for (given, is_no_part) in [
        (&["no_panel"][..], true),
        (&["poor_fit", "outline_differs", "blurred"], true),
        (&["poor_fit", "low_overlap"], true),
        (&["poor_fit"], false),
        (&["poor_fit", "marks_differ"], false),
        (&["outline_differs", "seen_through"], false),
        (&["shift_limit"], false),
        (&["no_panel", "camera_moved"], false),
        (&["other_scan", "no_panel"], false),
    ] {
        let judgement = concluded(&[located(given)]);
        let expected: Vec<&str> = is_no_part.then_some(NO_PART).into_iter().chain(given.iter().copied()).collect();
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Reject, expected), "{given:?}");
    }
    // An overlap that only leads to a review does not prove another extent.
    let nearly = located_with(&["poor_fit", "low_overlap"], &|code| code == "low_overlap");
    assert_eq!(codes(&concluded(&[nearly])), ["poor_fit", "low_overlap"]);
    let after_film = [finding(Kind::Inspect, Verdict::Fail, "broke"), located(&["no_panel"])];
    assert!(!codes(&concluded(&after_film)).contains(&NO_PART));
    let found_again = [
        located(&["no_panel"]),
        finding(Kind::Locate, Verdict::Accept, ""),
        finding(Kind::Plan, Verdict::Reject, "no_path"),
    ];
    assert!(!codes(&concluded(&found_again)).contains(&NO_PART));
}

/// A part that was sanded too deeply does not pass, even if a later film passes.
#[test]
fn a_rejected_abrasion_outweighs_a_film_that_passes() {
    let mut all = passed();
    all[3] = finding(Kind::Abrade, Verdict::Reject, "removal_too_deep");
    let accept = asked(Request::Accept, Answer::Done, 5);
    let judgement = conclude(Verdict::Pass, &all, &[accept], &[]);
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Reject, vec!["removal_too_deep"]));
}

/// A decision is effective only if it came after the finding and was accepted.
#[test]
fn a_review_counts_until_a_person_decides() {
    let mut all = passed();
    all[3] = finding(Kind::Abrade, Verdict::Review, "off_path");
    let verdict = |asked: &[RequestRecord]| conclude(Verdict::Pass, &all, asked, &[]).verdict;
    assert_eq!(verdict(&[]), Verdict::Review);
    for (request, answer, findings, expected) in [
        (Request::Accept, Answer::Done, 4, Verdict::Pass),
        (Request::Unhold { dried: false }, Answer::Done, 4, Verdict::Pass),
        (Request::Accept, Answer::Done, 3, Verdict::Review),
        (Request::Accept, Answer::Refused, 4, Verdict::Review),
        (Request::Accept, Answer::Failed, 4, Verdict::Review),
        (Request::Hold, Answer::Done, 4, Verdict::Review),
        (Request::Clear, Answer::Done, 4, Verdict::Review),
    ] {
        let one = [asked(request, answer, findings)];
        assert_eq!(verdict(&one), expected, "{request:?} {answer:?} after {findings}");
    }
    let unknown = RequestRecord { findings: None, ..asked(Request::Accept, Answer::Done, 4) };
    assert_eq!(verdict(&[unknown]), Verdict::Review, "when it was asked is not on the record");
    let accept = [asked(Request::Accept, Answer::Done, 4)];
    assert_eq!(finding_dispositions(&all, &accept)[3], Disposition::Decided(&accept[0]));
}

/// Each reason occurs once, in the order of the findings. The reason for ending the cycle is the last one, unless a
/// finding has the same reason.
#[test]
fn all_reasons_are_named_once_and_in_order() {
    let all = vec![
        finding(Kind::Locate, Verdict::Review, "low_overlap"),
        finding(Kind::Inspect, Verdict::Fail, "broke"),
        finding(Kind::Tool, Verdict::Review, "tool_silent"),
        finding(Kind::Abrade, Verdict::Review, "part"),
        finding(Kind::Tool, Verdict::Review, "tool_silent"),
    ];
    let unhold = asked(Request::Unhold { dried: false }, Answer::Done, 1);
    let because = [Reason::new("tool_silent", "the same in other words"), Reason::new("stopped", "stopped")];
    let judgement = conclude(Verdict::Aborted, &all, &[unhold], &because);
    assert_eq!(judgement.verdict, Verdict::Aborted);
    assert_eq!(codes(&judgement), ["tool_silent", "part", "stopped"], "the failed film is why it was abraded");
    let judgement = conclude(Verdict::Fail, &all[..2], &[], &[]);
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Review, vec!["low_overlap"]));
    let judgement = conclude(Verdict::Fail, &all[1..2], &[], &[]);
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Fail, vec!["broke"]));
}

const KINDS: [Kind; 8] =
    [Kind::Locate, Kind::Refine, Kind::Inspect, Kind::Plan, Kind::Verify, Kind::Abrade, Kind::Robot, Kind::Tool];
const FOUND: [Verdict; 6] =
    [Verdict::Accept, Verdict::Review, Verdict::Reject, Verdict::Pass, Verdict::Fail, Verdict::Invalid];
const ENDED: [Verdict; 6] =
    [Verdict::Pass, Verdict::Fail, Verdict::Review, Verdict::Reject, Verdict::Invalid, Verdict::Aborted];
const REQUESTS: [Request; 4] = [Request::Accept, Request::Unhold { dried: true }, Request::Hold, Request::Reset];
const CODES: [&str; 3] = ["one", "two", "three"];

fn findings() -> impl Strategy<Value = Vec<Finding>> {
    let one =
        (prop::sample::select(&KINDS[..]), prop::sample::select(&FOUND[..]), prop::sample::select(&CODES[..]));
    prop::collection::vec(one.prop_map(|(kind, verdict, code)| finding(kind, verdict, code)), 0..9)
}

fn requests() -> impl Strategy<Value = Vec<RequestRecord>> {
    let answers = prop::sample::select(&[Answer::Done, Answer::Refused, Answer::Failed][..]);
    let one = (prop::sample::select(&REQUESTS[..]), answers, 0_u64..10);
    prop::collection::vec(one.prop_map(|(request, answer, findings)| asked(request, answer, findings)), 0..5)
}

/// Returns whether the conditions for a pass are satisfied, by a second, independent implementation of the rules.
fn may_pass(findings: &[Finding], requests: &[RequestRecord]) -> bool {
    let is = |finding: &Finding, verdict| finding.judgement.verdict == verdict;
    let none_is_bad = findings.iter().all(|one| !is(one, Verdict::Reject) && !is(one, Verdict::Invalid));
    let is_decision = |one: &&RequestRecord| {
        one.answer == Some(Answer::Done)
            && [REQUESTS[0], REQUESTS[1]].iter().any(|request| one.wanted == RequestedAction::For(*request))
    };
    let last_decision = requests.iter().filter(is_decision).filter_map(|one| one.findings).max().unwrap_or(0);
    let all_decided = findings.iter().skip(last_decision as usize).all(|one| !is(one, Verdict::Review));
    let last_fail = findings.iter().rposition(|one| is(one, Verdict::Fail));
    let is_mended = last_fail.is_none_or(|at| {
        let rest = &findings[at..];
        let abraded = rest.iter().position(|one| one.kind == Kind::Abrade && !is(one, Verdict::Fail));
        let judged = rest.iter().rposition(|one| one.kind == Kind::Inspect && is(one, Verdict::Pass));
        abraded.zip(judged).is_some_and(|(abraded, judged)| abraded < judged)
    });
    none_is_bad && all_decided && is_mended
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    /// The verdict is never better than the worst effective finding, and has the reasons of all effective findings. A
    /// cycle passes only if it satisfies the conditions for a pass.
    #[test]
    fn no_verdict_is_better_than_its_worst_finding(
        findings in findings(),
        requests in requests(),
        ended in prop::sample::select(&ENDED[..]),
    ) {
        let judgement = conclude(ended, &findings, &requests, &[]);
        prop_assert!(judgement.verdict.severity() >= ended.severity());
        for (finding, disposition) in findings.iter().zip(finding_dispositions(&findings, &requests)) {
            let found = &finding.judgement;
            if disposition == Disposition::Counts {
                prop_assert!(judgement.verdict.severity() >= found.verdict.severity());
                let named = found.reasons.iter().all(|reason| judgement.reasons.contains(reason));
                prop_assert!(named || (found.verdict == Verdict::Fail && judgement.verdict != Verdict::Fail));
            }
        }
        let mut once = judgement.reasons.clone();
        once.dedup();
        prop_assert!(once.len() == judgement.reasons.len() && judgement.reasons.len() <= CODES.len());
        let is_pass = judgement.verdict == Verdict::Pass;
        prop_assert_eq!(is_pass, ended == Verdict::Pass && may_pass(&findings, &requests), "{:?}", judgement);
    }

    /// A record with its computed verdict has no contradiction. With the verdict pass instead, it has no contradiction
    /// only if the computed verdict is pass as well.
    #[test]
    fn a_pass_that_was_not_concluded_is_named(findings in findings(), requests in requests()) {
        let judgement = conclude(Verdict::Pass, &findings, &requests, &[]);
        let mut record = crate::record::tests::record(judgement.clone(), findings, requests);
        let is_shown = missing_film(&record.findings).is_none();
        prop_assert_eq!(record.verdict_contradictions().is_empty(), judgement.verdict != Verdict::Pass || is_shown);
        record.judgement = Some(Judgement { verdict: Verdict::Pass, reasons: vec![] });
        prop_assert_eq!(record.verdict_contradictions().is_empty(), judgement.verdict == Verdict::Pass && is_shown);
    }
}

/// A pass requires a film that passed after the last sanding pass. A record without findings, with only good findings
/// of other kinds, or with a sanding pass after its film does not show a pass. An air-run needs no film.
#[test]
fn a_pass_needs_a_film_that_passed() {
    let pass = Judgement { verdict: Verdict::Pass, reasons: vec![] };
    let unearned = |findings: Vec<Finding>, asked: Vec<RequestRecord>| {
        crate::record::tests::record(pass.clone(), findings, asked).verdict_contradictions()
    };
    assert_eq!(unearned(passed(), vec![]), [""; 0]);
    let told = |missing: &str| {
        [format!(
            "cycle 3 has the verdict pass, but {missing}: do not release the part, and inspect the part again"
        )]
    };
    let no_film = told("the record has 0 films (minimum 1)");
    assert_eq!(unearned(vec![], vec![]), no_film);
    assert_eq!(unearned(vec![finding(Kind::Locate, Verdict::Accept, "")], vec![]), no_film);
    let mut abraded_again = passed();
    abraded_again.push(finding(Kind::Abrade, Verdict::Accept, ""));
    assert_eq!(unearned(abraded_again, vec![]), told("1 sanding passes followed the last film (limit 0)"));
    let accepted = vec![finding(Kind::Inspect, Verdict::Accept, "")];
    let words = "the last film, finding 1, has the verdict accept instead of pass";
    assert_eq!(unearned(accepted, vec![]), told(words), "a film passes or does not");
    assert_eq!(unearned(vec![], vec![asked(Request::AirRun { max_moves: 3 }, Answer::Done, 0)]), [""; 0]);
    let refused = asked(Request::AirRun { max_moves: 3 }, Answer::Refused, 0);
    assert_eq!(unearned(vec![], vec![refused]), no_film);
}
