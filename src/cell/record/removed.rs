//! The removal from a part, as the findings of its cycle report it.

use super::finding::{Finding, Kind, name};

/// The removal by one contact path, from the poses that the robot reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathRemoval {
    /// Number of the pass, from 1.
    pub pass: u8,
    /// Expected depth over the treated grids, mean, µm.
    pub mean_um: f64,
    /// Upper bound of the depth at any place of the part over all passes so far, 95 %, µm.
    pub bound_um: f64,
}

/// Returns the removal path by path; empty if the recipe does not require a removal.
pub fn removed(findings: &[Finding]) -> Vec<PathRemoval> {
    let of_path = |finding: &Finding| {
        let [mean_um, bound_um] = [name::REMOVED_MEAN, name::REMOVED_BOUND].map(|name| finding.number(name));
        Some(PathRemoval { pass: finding.pass, mean_um: mean_um?, bound_um: bound_um? })
    };
    findings.iter().filter(|finding| finding.kind == Kind::Abrade).filter_map(of_path).collect()
}

/// Returns the upper 95 % bound of the removal anywhere on a part that was abraded in this number of passes of this
/// cycle, µm, including the removal of earlier cycles. If a pass has no report, its plan counts, since the whole plan
/// may have been executed. `None` if the bound is not known.
pub fn removed_bound_um(findings: &[Finding], passes: usize) -> Option<f64> {
    let bounds_of = |kind: Kind| -> Vec<f64> {
        let of_kind = findings.iter().filter(move |finding| finding.kind == kind);
        let checks = of_kind.flat_map(|finding| &finding.checks).filter(|check| check.name == name::REMOVED_BOUND);
        checks.filter_map(|check| check.value).collect()
    };
    let (executed, planned) = (bounds_of(Kind::Abrade), bounds_of(Kind::Plan));
    let is_whole = executed.len() >= passes;
    let known = planned.into_iter().filter(|_| !is_whole).chain(executed.iter().copied());
    let enough = is_whole || bounds_of(Kind::Plan).len() >= passes;
    known.reduce(f64::max).filter(|_| enough)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Check, Judgement};

    /// A plan has not removed anything, and without `[removal]` in the recipe the removal of a path is not known.
    #[test]
    fn what_each_path_removed() {
        let told = |kind: Kind, numbers: [Option<f64>; 2]| {
            let [mean_um, bound_um] = numbers;
            let mean = Check::new(name::REMOVED_MEAN, "µm", mean_um);
            Finding::new(kind, 1, Judgement::new(vec![], vec![]))
                .with_checks([mean, Check::new(name::REMOVED_BOUND, "µm", bound_um)])
        };
        let known = [Some(19.5), Some(24.0)];
        let findings = [told(Kind::Plan, known), told(Kind::Abrade, known), told(Kind::Abrade, [None; 2])];
        assert_eq!(removed(&findings), [PathRemoval { pass: 1, mean_um: 19.5, bound_um: 24.0 }]);
    }

    /// Two passes reported their removal; for a third one only its plan is known.
    #[test]
    fn what_was_planned_counts_without_a_report_of_what_was_executed() {
        let told = |kind: Kind, pass: u8, um: Option<f64>| {
            let judgement = panelprep_base::verdict::Judgement::new(vec![], vec![]);
            Finding::new(kind, pass, judgement).with_checks([panelprep_base::verdict::Check::new(
                name::REMOVED_BOUND,
                "µm",
                um,
            )])
        };
        let both = [
            told(Kind::Plan, 1, Some(20.0)),
            told(Kind::Abrade, 1, Some(18.0)),
            told(Kind::Plan, 2, Some(41.0)),
            told(Kind::Abrade, 2, Some(38.0)),
        ];
        assert_eq!(removed_bound_um(&both, 2), Some(38.0));
        assert_eq!(removed_bound_um(&both[..3], 2), Some(41.0), "the second pass broke off");
        assert_eq!(removed_bound_um(&both[..2], 2), None, "the second pass is not known");
        assert_eq!(removed_bound_um(&[told(Kind::Abrade, 1, None)], 1), None);
    }
}
