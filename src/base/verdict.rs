//! Verdicts, their reasons and the checks that they come from: what a gate reports, in words a person can act on.
//!
//! A check is one number with its unit, its limit and the source of the limit, and the consequence if the limit is
//! not met. A gate lists its checks; the verdict, the page, the JSON and the recording are all made from that one
//! list. A limit that is not met always has a consequence: the page prints "not allowed" beside such a value, and
//! nothing with such a row is accepted.

use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;

/// The result of a stage or a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, strum::IntoStaticStr, strum::VariantArray)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Verdict {
    /// The evidence permits continuing.
    Accept,
    /// A person must decide.
    Review,
    /// The result must not be used.
    Reject,
    /// The test was passed.
    Pass,
    /// The test was not passed.
    Fail,
    /// The test has no result; repeat it.
    Invalid,
    /// A fault of the cell ended the work.
    Aborted,
}

impl Verdict {
    /// Returns the verdict's keyword, on which scripts of users depend.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns how bad the verdict is: of two verdicts on one object the larger number applies. A review is worse than
    /// a fail, since no person has decided whether the evidence holds.
    pub fn severity(self) -> u8 {
        match self {
            Verdict::Accept | Verdict::Pass => 0,
            Verdict::Fail => 1,
            Verdict::Review => 2,
            Verdict::Invalid => 3,
            Verdict::Reject => 4,
            Verdict::Aborted => 5,
        }
    }

    /// Returns the process's exit code: 0 for a good verdict, 1 for any other verdict, 3 for a fault.
    pub fn exit_code(self) -> u8 {
        match self {
            Verdict::Accept | Verdict::Pass => 0,
            Verdict::Review | Verdict::Reject | Verdict::Fail | Verdict::Invalid => 1,
            Verdict::Aborted => 3,
        }
    }
}

impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.keyword())
    }
}

/// One reason for a verdict.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reason {
    /// A stable lower-case word, `shift_limit`; owned if it was read back from a store.
    pub code: Cow<'static, str>,
    /// The measurement, the limit and the required action.
    pub message: String,
}

impl Reason {
    /// Creates a reason from its code and message.
    pub fn new(code: &'static str, message: impl Into<String>) -> Self {
        Reason { code: Cow::Borrowed(code), message: message.into() }
    }
}

/// A verdict with its reasons; an acceptance needs none.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Reasons of the verdict.
    pub reasons: Vec<Reason>,
}

impl Judgement {
    /// Creates a rejection if there is a reason to reject, else a review if there is a reason for one, else an
    /// acceptance.
    pub fn new(reject: Vec<Reason>, review: Vec<Reason>) -> Self {
        let verdict = match (reject.is_empty(), review.is_empty()) {
            (true, true) => Verdict::Accept,
            (true, false) => Verdict::Review,
            (false, _) => Verdict::Reject,
        };
        Judgement { verdict, reasons: reject.into_iter().chain(review).collect() }
    }

    /// Combines the verdicts of two gates on one object: the worse verdict counts, and its reasons are first.
    pub fn combined_with(self, other: Judgement) -> Self {
        let is_worse = other.verdict.severity() > self.verdict.severity();
        let (worse, better) = if is_worse { (other, self) } else { (self, other) };
        Judgement { verdict: worse.verdict, reasons: [worse.reasons, better.reasons].concat() }
    }
}

/// The limit of a number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// No limit: the number is for information.
    Unlimited,
    /// The value may be at most the limit; the limit itself is allowed.
    AtMost(f64),
    /// The value must be at least the limit; the limit itself is allowed.
    AtLeast(f64),
    /// The value must be below the limit; the limit itself is not allowed.
    Below(f64),
}

impl Limit {
    /// Returns whether a value meets the limit. NaN meets no limit.
    pub fn is_met_by(self, value: f64) -> bool {
        match self {
            Limit::Unlimited => true,
            Limit::AtMost(limit) => value <= limit,
            Limit::AtLeast(limit) => value >= limit,
            Limit::Below(limit) => value < limit,
        }
    }

    /// Returns the limit's number.
    pub fn value(self) -> Option<f64> {
        match self {
            Limit::Unlimited => None,
            Limit::AtMost(limit) | Limit::AtLeast(limit) | Limit::Below(limit) => Some(limit),
        }
    }
}

/// The source of a limit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LimitSource {
    /// The recipe sets the limit, with this key.
    Recipe(Cow<'static, str>),
    /// The cell's file sets the limit, with this key.
    Cell(Cow<'static, str>),
    /// The program: one of its constants, or its own measurement.
    Program,
}

impl LimitSource {
    /// Returns the recipe as source, with this key, such as `locate.max_rms_mm`.
    pub const fn recipe(key: &'static str) -> Self {
        LimitSource::Recipe(Cow::Borrowed(key))
    }

    /// Returns the cell's file as source, with this key, such as `limits.min_break_mm2`.
    pub const fn cell(key: &'static str) -> Self {
        LimitSource::Cell(Cow::Borrowed(key))
    }
}

/// The consequence if a check's limit is not met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Nothing: the number is reported beside its limit, and decides nothing.
    #[default]
    None,
    /// A person must decide.
    Review,
    /// The object is rejected; a rejected test of the water film counts as invalid.
    Reject,
}

/// A number with its limit and the consequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// The quantity's name, as text.
    pub name: String,
    /// The value; `None` if it was not measured, which violates no limit.
    pub value: Option<f64>,
    /// The value's unit, "mm"; empty for shares and counts.
    pub unit: String,
    /// The limit.
    pub limit: Limit,
    /// The source of the limit; `None` if there is no limit, or if an earlier program did not store the source.
    #[serde(default)]
    pub set_by: Option<LimitSource>,
    /// The consequence if the limit is not met.
    #[serde(default)]
    pub severity: Severity,
    /// The code of the reason if the limit is not met; several checks may give the same reason.
    #[serde(default)]
    pub code: Option<Cow<'static, str>>,
    /// The reason's words, if the limit is not met.
    #[serde(default)]
    pub message: Option<String>,
}

/// Names of a check's fields that earlier versions of this program did not store.
pub const CHECK_FIELDS_ADDED_LATER: [&str; 4] = ["set_by", "severity", "code", "message"];

impl Check {
    /// Creates a check of a number without a limit; `None` means that the number was not measured.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, value: impl Into<Option<f64>>) -> Self {
        let (name, unit, value) = (name.into(), unit.into(), value.into());
        let (limit, severity) = (Limit::Unlimited, Severity::None);
        Check { name, value, unit, limit, set_by: None, severity, code: None, message: None }
    }

    /// Returns the same number with this limit.
    #[must_use]
    pub fn with_limit(self, limit: Limit, set_by: LimitSource) -> Self {
        Check { limit, set_by: Some(set_by), ..self }
    }

    /// Returns the same number with this upper limit.
    #[must_use]
    pub fn with_max(self, limit: f64, set_by: LimitSource) -> Self {
        self.with_limit(Limit::AtMost(limit), set_by)
    }

    /// Returns the same number with this lower limit.
    #[must_use]
    pub fn with_min(self, limit: f64, set_by: LimitSource) -> Self {
        self.with_limit(Limit::AtLeast(limit), set_by)
    }

    /// Returns the same check with this consequence: if its limit is not met, the object is rejected for this reason.
    #[must_use]
    pub fn or_reject(self, code: &'static str, words: impl FnOnce() -> String) -> Self {
        self.with_consequence(Severity::Reject, code, words)
    }

    /// Returns the same check with this consequence: if its limit is not met, a person decides for this reason.
    #[must_use]
    pub fn or_review(self, code: &'static str, words: impl FnOnce() -> String) -> Self {
        self.with_consequence(Severity::Review, code, words)
    }

    /// Returns the same check with this consequence, for this reason, if its limit is not met.
    #[must_use]
    pub fn with_consequence(self, severity: Severity, code: &'static str, words: impl FnOnce() -> String) -> Self {
        let is_violated = !self.is_met();
        self.with_consequence_if(is_violated, severity, code, words)
    }

    /// Returns the same check with this consequence, for this reason, if `is_violated`. Used for a number that had to
    /// be measured and was not, or if the limit alone does not decide.
    #[must_use]
    pub fn with_consequence_if(
        self,
        is_violated: bool,
        severity: Severity,
        code: &'static str,
        words: impl FnOnce() -> String,
    ) -> Self {
        let check = Check { severity, code: Some(Cow::Borrowed(code)), message: is_violated.then(words), ..self };
        if is_violated { check } else { check.without_failed_limit() }
    }

    /// Returns the same number, without its limit if the limit is not met: the limit decides nothing here.
    fn without_failed_limit(self) -> Self {
        if self.is_met() { self } else { Check { limit: Limit::Unlimited, set_by: None, ..self } }
    }

    /// Returns the same check with the given reason, if there is one.
    #[must_use]
    pub fn with_reason(self, reason: Option<Reason>, severity: Severity) -> Self {
        let Some(Reason { code, message }) = reason else { return self };
        Check { severity, code: Some(code), message: Some(message), ..self }
    }

    /// Returns the same check without consequence: another finding makes it meaningless.
    #[must_use]
    pub fn without_consequence(self) -> Self {
        Check { severity: Severity::None, code: None, message: None, ..self }.without_failed_limit()
    }

    /// Returns the same check with a consequence no worse than this.
    #[must_use]
    pub fn with_max_severity(self, severity: Severity) -> Self {
        Check { severity: self.severity.min(severity), ..self }
    }

    /// Returns whether the value meets its limit; a value that was not measured violates no limit.
    pub fn is_met(&self) -> bool {
        self.value.is_none_or(|value| self.limit.is_met_by(value))
    }

    /// Returns the reason that the check gives, if its limit is not met and this has a consequence.
    pub fn reason(&self) -> Option<Reason> {
        let (code, message) = (self.code.clone()?, self.message.clone()?);
        (self.severity > Severity::None).then_some(Reason { code, message })
    }

    /// Returns the reason for a review of a limit that is not met, if no rule states the consequence. This is a fault
    /// of the program; the review is the safe reaction.
    fn unjudged_reason(&self) -> Option<Reason> {
        let is_judged = self.is_met() || self.reason().is_some();
        let (value, bound) = (self.value?, self.limit.value().filter(|_| !is_judged)?);
        let message = format!(
            "{}: found {value} {unit} (limit {bound} {unit}), but the program defines no consequence for this \
             limit; examine this value before you accept the result, and report a fault of the program",
            self.name,
            unit = self.unit
        );
        Some(Reason { code: Cow::Borrowed("limit"), message })
    }
}

impl Judgement {
    /// Returns the verdict of one gate from its checks, in their order; a reason that several checks give is listed
    /// once.
    pub fn from_checks<'c>(checks: impl IntoIterator<Item = &'c Check>) -> Self {
        let (mut reject, mut review, mut unjudged) = (Vec::new(), Vec::new(), Vec::new());
        for check in checks {
            unjudged.extend(check.unjudged_reason());
            let Some(reason) = check.reason() else { continue };
            let list = if check.severity == Severity::Reject { &mut reject } else { &mut review };
            if !list.contains(&reason) {
                list.push(reason);
            }
        }
        review.retain(|reason| !reject.contains(reason));
        if reject.is_empty() && review.is_empty() {
            review = unjudged;
        }
        Judgement::new(reject, review)
    }

    /// Returns the verdict with these checks added: a good verdict becomes a review if one of their limits is not
    /// met without a stated consequence.
    #[must_use]
    pub fn with_checks<'c>(self, checks: impl IntoIterator<Item = &'c Check>) -> Self {
        if self.verdict.severity() > 0 {
            return self;
        }
        let unjudged: Vec<Reason> = checks.into_iter().filter_map(Check::unjudged_reason).collect();
        self.combined_with(Judgement::new(vec![], unjudged))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_met_or_violated_by_a_value() {
        assert!(
            Limit::AtMost(1.0).is_met_by(1.0)
                && !Limit::Below(1.0).is_met_by(1.0)
                && Limit::AtLeast(1.0).is_met_by(1.0)
        );
        let not_a_number = [Limit::AtMost(1.0), Limit::AtLeast(1.0), Limit::Below(1.0)];
        assert!(not_a_number.iter().all(|limit| !limit.is_met_by(f64::NAN)));
    }

    fn rms(mm: impl Into<Option<f64>>) -> Check {
        let check = Check::new("residual", "mm", mm).with_max(0.25, LimitSource::recipe("locate.max_rms_mm"));
        check.or_reject("poor_fit", || "too much".to_owned())
    }

    #[test]
    fn a_check_gives_a_reason_if_its_limit_is_not_met() {
        let codes = |check: Check| -> Vec<String> {
            let judgement = Judgement::from_checks(&[check]);
            judgement.reasons.into_iter().map(|reason| reason.code.into_owned()).collect()
        };
        assert_eq!(codes(rms(0.25)), Vec::<String>::new());
        assert_eq!(codes(rms(None)), Vec::<String>::new(), "what was not measured breaks no limit");
        assert_eq!(codes(rms(0.26)), ["poor_fit"]);
        assert_eq!(codes(rms(f64::NAN)), ["poor_fit"]);
        assert_eq!(codes(rms(0.26).without_consequence()), Vec::<String>::new());
    }

    /// Two numbers of the outline give the same reason: the worse consequence counts.
    #[test]
    fn a_reason_that_two_checks_give_is_listed_once() {
        let both = |severity: Severity| {
            let check = Check::new("outline", "px", 2.0).with_max(1.0, LimitSource::Program);
            check.with_consequence(severity, "outline_differs", || "it differs".to_owned())
        };
        let judgement = Judgement::from_checks(&[both(Severity::Review), both(Severity::Review)]);
        assert_eq!((judgement.verdict, judgement.reasons.len()), (Verdict::Review, 1));
        let judgement = Judgement::from_checks(&[both(Severity::Review), both(Severity::Reject)]);
        assert_eq!((judgement.verdict, judgement.reasons.len()), (Verdict::Reject, 1));
    }

    /// The page prints "not allowed" beside a limit that is not met. No such row may remain on an accepted result
    /// in these cases: a gate that tolerates more than it prints, a number with a limit but no consequence, and a
    /// consequence that was removed.
    #[test]
    fn an_accepted_result_violates_no_limit() {
        let over =
            || Check::new("overhang", "mm", 2.005).with_max(2.0, LimitSource::recipe("path.edge_overhang_mm"));
        let words = || "too far".to_owned();
        let tolerated = over().with_consequence_if(false, Severity::Review, "edge_overhang", words);
        let freed = over().or_review("edge_overhang", words).without_consequence();
        for check in [tolerated, freed] {
            assert_eq!((check.is_met(), check.limit, &check.set_by), (true, Limit::Unlimited, &None));
            assert_eq!(Judgement::from_checks(&[check]).verdict, Verdict::Accept);
        }
        let kept = Check::new("overhang", "mm", 1.99).with_max(2.0, LimitSource::Program).without_consequence();
        assert_eq!(kept.limit, Limit::AtMost(2.0), "a limit that is kept stays beside its number");
        // No rule states the consequence: a person must decide.
        for number in [2.005, f64::NAN] {
            let unjudged = Check { value: Some(number), ..over() };
            let judgement = Judgement::from_checks(std::slice::from_ref(&unjudged));
            assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Review, "limit"));
            let accepted = Judgement::new(vec![], vec![]);
            assert_eq!(accepted.with_checks(&[unjudged]).verdict, Verdict::Review);
        }
        let judged = over().or_reject("edge_overhang", words);
        assert_eq!(
            Judgement::from_checks(&[over(), judged.clone()]).reasons.len(),
            1,
            "that it is not kept is said"
        );
        assert_eq!(judged.with_max_severity(Severity::Review).severity, Severity::Review);
    }

    /// An earlier version of this program stored only name, value, unit and limit.
    #[test]
    fn a_check_of_an_earlier_version_is_read() {
        let text = r#"{"name": "residual", "value": 0.1, "unit": "mm", "limit": {"at_most": 0.25}}"#;
        let read: Check = serde_json::from_str(text).expect("read");
        assert_eq!(read, Check::new("residual", "mm", 0.1).with_stored_limit(Limit::AtMost(0.25)));
        let written = serde_json::to_value(rms(0.26)).expect("written");
        assert!(CHECK_FIELDS_ADDED_LATER.iter().all(|name| written.get(name).is_some()), "{written}");
        assert_eq!(serde_json::from_value::<Check>(written).expect("read"), rms(0.26));
    }

    impl Check {
        fn with_stored_limit(self, limit: Limit) -> Self {
            Check { limit, ..self }
        }
    }

    #[test]
    fn one_reason_to_reject_decides_the_verdict() {
        let reason = |code| Reason::new(code, "measured 2 mm, allowed 1 mm");
        assert_eq!(Judgement::new(vec![], vec![]).verdict, Verdict::Accept);
        assert_eq!(Judgement::new(vec![], vec![reason("a")]).verdict, Verdict::Review);
        let both = Judgement::new(vec![reason("b")], vec![reason("a")]);
        assert_eq!((both.verdict, &*both.reasons[0].code, both.reasons.len()), (Verdict::Reject, "b", 2));
        let (accept, review) = (Judgement::new(vec![], vec![]), Judgement::new(vec![], vec![reason("a")]));
        assert_eq!(accept.clone().combined_with(accept.clone()), accept);
        assert_eq!(accept.combined_with(review.clone()), review);
        assert_eq!(review.combined_with(Judgement::new(vec![reason("b")], vec![])), both);
    }
}
