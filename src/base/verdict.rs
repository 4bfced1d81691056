//! Verdicts, their reasons and the checks that lead to them.
//!
//! A check is one number with its unit, its limit, the source of the limit, and the consequence if the limit is
//! violated. The verdict, the page, the JSON and the recording are all generated from the list of checks. A violated
//! limit always has a consequence: the page prints "not allowed" beside the value, and a result with such a check is
//! never accepted.

use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;

/// The result of a stage or a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, strum::IntoStaticStr, strum::VariantArray)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Verdict {
    /// The evidence is sufficient to continue.
    Accept,
    /// A person must decide.
    Review,
    /// The result must not be used.
    Reject,
    /// The panel passed the water-break test.
    Pass,
    /// The panel failed the water-break test.
    Fail,
    /// The water-break test has no result; it must be repeated.
    Invalid,
    /// The work was ended because of a fault of the cell.
    Aborted,
}

impl Verdict {
    /// Returns the verdict's keyword. Users' scripts depend on it.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns the severity of the verdict: of two verdicts on one object the one with the larger severity applies. A
    /// review is worse than a fail, because no person has decided yet whether the evidence is valid.
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
    /// A stable lower-case keyword such as `shift_limit`; owned if it was read from a store.
    pub code: Cow<'static, str>,
    /// The measured value, the limit and the required action.
    pub message: String,
}

impl Reason {
    /// Creates a reason from its code and message.
    pub fn new(code: &'static str, message: impl Into<String>) -> Self {
        Reason { code: Cow::Borrowed(code), message: message.into() }
    }
}

/// A verdict with its reasons; an acceptance has none.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Reasons for the verdict.
    pub reasons: Vec<Reason>,
}

impl Judgement {
    /// Creates a rejection if there is a reason to reject, otherwise a review if there is a reason to review, otherwise
    /// an acceptance.
    pub fn new(reject: Vec<Reason>, review: Vec<Reason>) -> Self {
        let verdict = match (reject.is_empty(), review.is_empty()) {
            (true, true) => Verdict::Accept,
            (true, false) => Verdict::Review,
            (false, _) => Verdict::Reject,
        };
        Judgement { verdict, reasons: reject.into_iter().chain(review).collect() }
    }

    /// Combines the verdicts of two gates on one object: the worse verdict applies, and its reasons come first.
    pub fn combined_with(self, other: Judgement) -> Self {
        let is_worse = other.verdict.severity() > self.verdict.severity();
        let (worse, better) = if is_worse { (other, self) } else { (self, other) };
        Judgement { verdict: worse.verdict, reasons: [worse.reasons, better.reasons].concat() }
    }
}

/// The limit of a check's value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// No limit: the value is for information.
    Unlimited,
    /// The value must be at most the limit.
    AtMost(f64),
    /// The value must be at least the limit.
    AtLeast(f64),
    /// The value must be below the limit, and not equal to it.
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

    /// Returns the limit's value; `None` if there is no limit.
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
    /// The recipe, with the key of the limit.
    Recipe(Cow<'static, str>),
    /// The cell's file, with the key of the limit.
    Cell(Cow<'static, str>),
    /// The program: a constant, or a value that the program measured.
    Program,
}

impl LimitSource {
    /// Creates the recipe as source, with this key, such as `locate.max_rms_mm`.
    pub const fn recipe(key: &'static str) -> Self {
        LimitSource::Recipe(Cow::Borrowed(key))
    }

    /// Creates the cell's file as source, with this key, such as `limits.min_break_mm2`.
    pub const fn cell(key: &'static str) -> Self {
        LimitSource::Cell(Cow::Borrowed(key))
    }
}

/// The consequence of a violated limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// No consequence: the value and its limit are reported for information.
    #[default]
    None,
    /// A person must decide.
    Review,
    /// The object is rejected; in the water-break test, the result is invalid.
    Reject,
}

/// A check: a measured value with its limit, and the consequence if the limit is violated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// The name of the measured quantity, as text for people.
    pub name: String,
    /// The measured value; `None` if it was not measured. A missing value violates no limit.
    pub value: Option<f64>,
    /// The value's unit, such as "mm"; empty for fractions and counts.
    pub unit: String,
    /// The limit of the value.
    pub limit: Limit,
    /// The source of the limit; `None` if there is no limit.
    pub set_by: Option<LimitSource>,
    /// The consequence if the limit is not met.
    pub severity: Severity,
    /// The code of the reason if the limit is not met; several checks may give the same reason.
    pub code: Option<Cow<'static, str>>,
    /// The reason's words, if the limit is not met.
    pub message: Option<String>,
}

impl Check {
    /// Creates a check of a value without a limit; `None` means that the value was not measured.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, value: impl Into<Option<f64>>) -> Self {
        let (name, unit, value) = (name.into(), unit.into(), value.into());
        let (limit, severity) = (Limit::Unlimited, Severity::None);
        Check { name, value, unit, limit, set_by: None, severity, code: None, message: None }
    }

    /// Returns the check with this limit.
    #[must_use]
    pub fn with_limit(self, limit: Limit, set_by: LimitSource) -> Self {
        Check { limit, set_by: Some(set_by), ..self }
    }

    /// Returns the check with this upper limit.
    #[must_use]
    pub fn with_max(self, limit: f64, set_by: LimitSource) -> Self {
        self.with_limit(Limit::AtMost(limit), set_by)
    }

    /// Returns the check with this lower limit.
    #[must_use]
    pub fn with_min(self, limit: f64, set_by: LimitSource) -> Self {
        self.with_limit(Limit::AtLeast(limit), set_by)
    }

    /// Returns the check with this reason: if its limit is violated, the object is rejected.
    #[must_use]
    pub fn or_reject(self, code: &'static str, words: impl FnOnce() -> String) -> Self {
        self.with_consequence(Severity::Reject, code, words)
    }

    /// Returns the check with this reason: if its limit is violated, a person must decide.
    #[must_use]
    pub fn or_review(self, code: &'static str, words: impl FnOnce() -> String) -> Self {
        self.with_consequence(Severity::Review, code, words)
    }

    /// Returns the check with this consequence and this reason, which apply if its limit is violated.
    #[must_use]
    pub fn with_consequence(self, severity: Severity, code: &'static str, words: impl FnOnce() -> String) -> Self {
        let is_violated = !self.is_met();
        self.with_consequence_if(is_violated, severity, code, words)
    }

    /// Returns the check with this consequence and this reason, which apply if `is_violated`. This is for a required
    /// value that was not measured, or if more than the limit decides.
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

    /// Returns the check without its limit if the limit is violated, because the limit decides nothing here.
    fn without_failed_limit(self) -> Self {
        if self.is_met() { self } else { Check { limit: Limit::Unlimited, set_by: None, ..self } }
    }

    /// Returns the check with this reason, if there is one.
    #[must_use]
    pub fn with_reason(self, reason: Option<Reason>, severity: Severity) -> Self {
        let Some(Reason { code, message }) = reason else { return self };
        Check { severity, code: Some(code), message: Some(message), ..self }
    }

    /// Returns the check without a consequence, because another finding makes the check meaningless.
    #[must_use]
    pub fn without_consequence(self) -> Self {
        Check { severity: Severity::None, code: None, message: None, ..self }.without_failed_limit()
    }

    /// Returns the check with a consequence that is at most this severe.
    #[must_use]
    pub fn with_max_severity(self, severity: Severity) -> Self {
        Check { severity: self.severity.min(severity), ..self }
    }

    /// Returns whether the value meets its limit. A value that was not measured violates no limit.
    pub fn is_met(&self) -> bool {
        self.value.is_none_or(|value| self.limit.is_met_by(value))
    }

    /// Returns the reason of the check if its limit is violated and this has a consequence.
    pub fn reason(&self) -> Option<Reason> {
        let (code, message) = (self.code.clone()?, self.message.clone()?);
        (self.severity > Severity::None).then_some(Reason { code, message })
    }

    /// Returns the reason for a review if the limit is violated but the program defines no consequence. This is a fault
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
    /// Returns the verdict of one gate from its checks, with the reasons in the order of the checks. A reason that
    /// several checks give is listed once.
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

    /// Returns the verdict with these checks added. A good verdict becomes a review if the limit of an added check is
    /// violated and has no consequence.
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

    /// Two checks of the outline give the same reason: the more severe consequence applies.
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

    /// The page prints "not allowed" beside a violated limit. An accepted result must not contain such a row. Three
    /// causes are tested: the gate tolerates more than the printed limit, a limit has no consequence, and a consequence
    /// was removed.
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
        // The program defines no consequence: a person must decide.
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
