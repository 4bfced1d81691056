//! The verdict of a cycle: the verdict with which its state table ended, combined with the findings of its phases.
//!
//! The verdict is never better than the worst effective finding, and contains the reasons of all effective findings. A
//! finding is effective according to these rules:
//!
//! - `reject` and `invalid` are always effective.
//! - `review` is effective until a person decides: by an accept after the finding, or by an unhold after which the
//!   cycle measures again or continues. A fault of the cell (camera, link, feedback, tool) is stored as such a review.
//! - `fail` is effective until the panel was sanded and a later film was evaluated, as in a cycle that ends with
//!   `pass`. It is the reason for the sanding pass, and a reason for the verdict only if the verdict is `fail`.
//!
//! A request contains the number of findings at the time of the decision ([`RequestRecord::findings`]), so that the
//! order of findings and decisions is recorded.

use super::requests::{Answer, RequestRecord, RequestedAction};
use super::{Check, CycleId, Finding, Kind, Severity};
use crate::cycle::Request;
use panelprep_base::number_text::utc_text;
use panelprep_base::verdict::{Judgement, Reason, Verdict};

/// The effect of a finding on the verdict of its cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disposition<'a> {
    /// The finding is good: its verdict is accept or pass.
    Good,
    /// The finding is effective.
    Counts,
    /// A review that a person has decided by this request.
    Decided(&'a RequestRecord),
    /// A failed film that was followed by a sanding pass and another film.
    Superseded,
}

impl Disposition<'_> {
    /// Returns for a page how a finding that is not good was resolved: the person and the time of the decision. `None`
    /// if it was not resolved.
    pub fn describe(self) -> Option<String> {
        let decided = |asked: &RequestRecord| {
            let what = match asked.wanted {
                RequestedAction::For(Request::Unhold { dried: true }) => "measured again on the dried panel",
                RequestedAction::For(Request::Unhold { dried: false }) => "continued",
                _ => "accepted",
            };
            let who = asked.who.as_ref().map_or("not recorded".to_owned(), ToString::to_string);
            format!("{what} {}, by {who}", utc_text(asked.unix_ms.div_euclid(1_000)))
        };
        match self {
            Disposition::Good | Disposition::Counts => None,
            Disposition::Decided(asked) => Some(decided(asked)),
            Disposition::Superseded => Some("superseded by a later film".to_owned()),
        }
    }
}

/// Returns the effect of each finding on the verdict, in the order of the findings.
pub fn finding_dispositions<'a>(findings: &[Finding], asked: &'a [RequestRecord]) -> Vec<Disposition<'a>> {
    (0..findings.len()).map(|index| finding_disposition(index, findings, asked)).collect()
}

fn finding_disposition<'a>(index: usize, findings: &[Finding], asked: &'a [RequestRecord]) -> Disposition<'a> {
    let Some((finding, later)) = findings.get(index..).and_then(<[Finding]>::split_first) else {
        return Disposition::Counts;
    };
    match finding.judgement.verdict {
        Verdict::Accept | Verdict::Pass => Disposition::Good,
        Verdict::Review => {
            let decision = asked.iter().find(|asked| is_decision_on(asked, index));
            decision.map_or(Disposition::Counts, Disposition::Decided)
        }
        Verdict::Fail => {
            let mut later = later.iter();
            let is_abraded = later.any(|later| later.kind == Kind::Abrade);
            let is_judged = later.any(|later| {
                let verdict = later.judgement.verdict;
                later.kind == Kind::Inspect && matches!(verdict, Verdict::Pass | Verdict::Fail | Verdict::Invalid)
            });
            if is_abraded && is_judged { Disposition::Superseded } else { Disposition::Counts }
        }
        Verdict::Reject | Verdict::Invalid | Verdict::Aborted => Disposition::Counts,
    }
}

/// Returns whether this request is a person's decision about the finding with this index.
fn is_decision_on(asked: &RequestRecord, index: usize) -> bool {
    let wanted = matches!(asked.wanted, RequestedAction::For(Request::Accept | Request::Unhold { .. }));
    let is_later = asked.findings.is_some_and(|kept| u64::try_from(index).is_ok_and(|index| index < kept));
    wanted && asked.answer == Some(Answer::Done) && is_later
}

/// Returns the verdict of a cycle whose state table ended with the verdict `ended`. `because` contains the reasons for
/// ending the cycle; those with a code that no finding has are added after the reasons of the findings.
pub fn conclude(ended: Verdict, findings: &[Finding], asked: &[RequestRecord], because: &[Reason]) -> Judgement {
    let counting = || {
        let all = findings.iter().zip(finding_dispositions(findings, asked));
        all.filter(|(_, disposition)| *disposition == Disposition::Counts).map(|(finding, _)| &finding.judgement)
    };
    let found = counting().map(|judgement| judgement.verdict);
    // Of two equally severe verdicts the first one is used, so that the verdict of the state table is kept.
    let verdict = found.fold(ended, |worst, found| if found.severity() > worst.severity() { found } else { worst });
    let mut reasons: Vec<Reason> = Vec::new();
    let of_verdict = |judgement: &&Judgement| judgement.verdict != Verdict::Fail || verdict == Verdict::Fail;
    for reason in counting().filter(of_verdict).flat_map(|judgement| &judgement.reasons) {
        if !reasons.contains(reason) {
            reasons.push(reason.clone());
        }
    }
    let is_new: Vec<Reason> =
        because.iter().filter(|why| reasons.iter().all(|reason| reason.code != why.code)).cloned().collect();
    reasons.extend(is_new);
    if verdict == Verdict::Reject && found_no_part(findings) {
        reasons.insert(0, no_part_reason());
    }
    Judgement { verdict, reasons }
}

/// Code of the reason that no part was examined in the cycle.
pub const NO_PART: &str = "no_part";

/// Codes of a localization in which the extent or the outline differs from that of the taught panel.
const OTHER_EXTENT_CODES: [&str; 3] = ["outline_differs", "low_overlap", "seen_through"];
/// Codes of a scan that cannot show what is in the cell.
const UNUSABLE_SCAN_CODES: [&str; 2] = ["camera_moved", "other_scan"];

/// Returns whether there was no part in the cell. In this case the last localization was rejected, either because the
/// search box is empty, or because the surface of the object and its extent each differ from those of the taught panel
/// by more than the limit of a rejection. If only one of them differs, the object may be a damaged part,
/// which is a nonconformance. A cycle with a film or a sanding pass had a part.
fn found_no_part(findings: &[Finding]) -> bool {
    if findings.iter().any(|finding| matches!(finding.kind, Kind::Inspect | Kind::Abrade)) {
        return false;
    }
    let located = findings.iter().rfind(|finding| finding.kind == Kind::Locate);
    located.filter(|located| located.judgement.verdict == Verdict::Reject).is_some_and(|located| {
        let has = |code: &&str| located.judgement.reasons.iter().any(|reason| reason.code == *code);
        // The reasons of a rejection also contain reasons that alone would lead to a review.
        let is_rejected_by = |code: &str| {
            let breaks = |check: &Check| check.severity == Severity::Reject && !check.is_met();
            located.checks.iter().any(|check| check.code.as_deref() == Some(code) && breaks(check))
        };
        let is_other = is_rejected_by("poor_fit") && OTHER_EXTENT_CODES.into_iter().any(is_rejected_by);
        (has(&"no_panel") || is_other) && !UNUSABLE_SCAN_CODES.iter().any(has)
    })
}

/// Returns whether the reasons of a cycle's verdict state that no part was examined.
pub fn states_no_part(reasons: &[Reason]) -> bool {
    reasons.first().is_some_and(|first| first.code == NO_PART)
}

fn no_part_reason() -> Reason {
    Reason::new(
        NO_PART,
        "the cell is empty, or contains an object other than the taught panel: the part of this cycle was not examined. Insert the correct part and start again. If the correct part is in the cell, let an inspector examine it",
    )
}

/// Returns why the findings do not prove that the last film passed and that no sanding pass followed it, as text with
/// number and limit; `None` if they prove it.
pub(super) fn missing_film(findings: &[Finding]) -> Option<String> {
    let Some(last) = findings.iter().rposition(|finding| finding.kind == Kind::Inspect) else {
        return Some("the record has 0 films (minimum 1)".to_owned());
    };
    let abrasions = findings.iter().skip(last).filter(|finding| finding.kind == Kind::Abrade).count();
    if abrasions > 0 {
        return Some(format!("{abrasions} sanding passes followed the last film (limit 0)"));
    }
    let verdict = findings.get(last)?.judgement.verdict;
    let found =
        || format!("the last film, finding {}, has the verdict {} instead of pass", last + 1, verdict.keyword());
    (verdict != Verdict::Pass).then(found)
}

/// Returns the findings that contradict the verdict `pass` or `accept` of this cycle, as texts; empty for any other
/// verdict.
pub(super) fn contradicting_findings(
    id: CycleId,
    verdict: Verdict,
    findings: &[Finding],
    asked: &[RequestRecord],
) -> Vec<String> {
    if !matches!(verdict, Verdict::Pass | Verdict::Accept) {
        return Vec::new();
    }
    let all = findings.iter().zip(finding_dispositions(findings, asked)).enumerate();
    let counting = all.filter(|(_, (_, disposition))| *disposition == Disposition::Counts);
    let words = |(index, (finding, _)): (usize, (&Finding, Disposition<'_>))| {
        let found = finding.judgement.verdict;
        let reasons: Vec<String> = finding
            .judgement
            .reasons
            .iter()
            .map(|reason| format!("{} ({})", reason.message, reason.code))
            .collect();
        let what = match found {
            Verdict::Review => "a review that no person accepted",
            other => other.keyword(),
        };
        format!(
            "cycle {} has the verdict {}, but its finding {} ({}, pass {}) is {what}: {}",
            id,
            verdict.keyword(),
            index + 1,
            finding.kind.keyword(),
            finding.pass,
            if reasons.is_empty() { "no reason is given".to_owned() } else { reasons.join("; ") }
        )
    };
    counting.map(words).collect()
}

#[cfg(test)]
mod tests;
