//! Verdicts and their reasons.

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
    /// The verdict's keyword, which users use in scripts.
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

    /// The process's exit code: 0 for a good verdict, 1 for any other verdict, 3 for a fault.
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
    /// Reject if there is a reason to, else review if there is one, else accept.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_reason_to_reject_outweighs_the_rest() {
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
