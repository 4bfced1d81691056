//! Is a calibration still true? What a look at a known target found, and whether a cycle may start on it.

use crate::cell::Limits;
use crate::geometry::{Base, Board as BoardFrame, Point, Rigid};
use crate::verdict::{Judgement, Reason};
use crate::words::apart;

/// One look at a fixed target, or one touch.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// What was verified: `scanner`, `flange_camera` or `tool`.
    pub subject: String,
    /// Largest distance between where the target is known to be and where it was found, mm.
    pub error_mm: f64,
    /// What was allowed, mm.
    pub limit_mm: f64,
    /// Content hash of the calibration files that were used, in the order of the cell's keys.
    pub calibration_hash: String,
    /// When, seconds since 1970.
    pub at_unix_s: i64,
}

/// What the cell's file demands of the last verification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demands {
    /// Largest error, mm.
    pub limit_mm: f64,
    /// Largest age, hours.
    pub max_age_h: f64,
}

impl Demands {
    /// As the cell's file states them.
    pub fn of(limits: &Limits) -> Self {
        Demands { limit_mm: limits.verify_limit_mm(), max_age_h: limits.verify_max_age_h() }
    }
}

/// How far a board was found from where it is known to be: the largest distance of its corners, mm.
pub fn distance_mm(
    known: &Rigid<Base, BoardFrame>,
    found: &Rigid<Base, BoardFrame>,
    corners: &[Point<BoardFrame>],
) -> f64 {
    corners.iter().map(|&corner| known.distance_at_mm(*found, corner)).fold(0.0, f64::max)
}

/// Was a look, or a touch, farther off than the cell's file allows today? A NaN is beyond every limit.
pub fn beyond(last: &Verification, demands: Demands) -> Option<Reason> {
    let (subject, found, allowed) = (&last.subject, last.error_mm, demands.limit_mm);
    (found.is_nan() || found > allowed).then(|| {
        let [found, allowed] = apart(found, allowed, 3);
        let message = format!(
            "the last verification of {subject} was {found} mm off, allowed are {allowed} mm; look whether something \
             was bumped, calibrate {subject} again, and verify it"
        );
        Reason::new("verification_limit", message)
    })
}

fn advice(subject: &str) -> String {
    format!("run `panelprep calibrate verify --camera {}`", subject.replace('_', "-"))
}

/// May a cycle start? `last` is the newest verification of this subject; `calibration_hash` is of the files in use now.
///
/// Rejects where it is missing, older than allowed, from the future, beyond the limit, or of other calibration files.
pub fn health(
    subject: &str,
    last: Option<&Verification>,
    calibration_hash: &str,
    now_unix_s: i64,
    demands: Demands,
) -> Judgement {
    let Some(last) = last else {
        let message = format!("{subject} was never verified; {}", advice(subject));
        return Judgement::of(vec![Reason::new("not_verified", message)], vec![]);
    };
    let mut reject = Vec::new();
    let age_h = (now_unix_s - last.at_unix_s) as f64 / 3600.0;
    if age_h < 0.0 {
        let message =
            format!("the last verification of {subject} lies {:.1} h ahead; set the computer's clock", -age_h);
        reject.push(Reason::new("verification_ahead", message));
    }
    if age_h > demands.max_age_h {
        let [age, allowed] = apart(age_h, demands.max_age_h, 1);
        let message = format!("{subject} was verified {age} h ago, allowed are {allowed} h; {}", advice(subject));
        reject.push(Reason::new("verification_old", message));
    }
    reject.extend(beyond(last, demands));
    if last.calibration_hash != calibration_hash {
        let message =
            format!("{subject} was verified with other calibration files than today's; {}", advice(subject));
        reject.push(Reason::new("verification_other", message));
    }
    Judgement::of(reject, vec![])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::Verdict;
    use nalgebra::{Isometry3, Vector3};

    const DEMANDS: Demands = Demands { limit_mm: 0.5, max_age_h: 24.0 };

    fn verified(error_mm: f64, at_unix_s: i64) -> Verification {
        let subject = "scanner".to_owned();
        Verification { subject, error_mm, limit_mm: 0.5, calibration_hash: "ab".to_owned(), at_unix_s }
    }

    #[test]
    fn a_cycle_starts_only_on_a_fresh_and_good_verification() {
        let now = 1_700_000_000;
        let judge = |last: Option<Verification>, hash: &str| health("scanner", last.as_ref(), hash, now, DEMANDS);
        assert_eq!(judge(Some(verified(0.2, now - 3600)), "ab").verdict, Verdict::Accept);
        for (last, hash, code) in [
            (None, "ab", "not_verified"),
            (Some(verified(0.2, now - 25 * 3600)), "ab", "verification_old"),
            (Some(verified(0.2, now + 60)), "ab", "verification_ahead"),
            (Some(verified(0.6, now - 60)), "ab", "verification_limit"),
            (Some(verified(f64::NAN, now - 60)), "ab", "verification_limit"),
            (Some(verified(0.2, now - 60)), "cd", "verification_other"),
        ] {
            let judged = judge(last, hash);
            assert_eq!(judged.verdict, Verdict::Reject);
            assert!(judged.reasons.iter().any(|reason| reason.code == code), "{code}: {judged:?}");
            assert!(
                judged.reasons.iter().all(|reason| reason.message.contains("verify") || code.ends_with("ahead"))
            );
        }
    }

    /// By hand: turned by 0.01 rad about its origin, a corner 100 mm away is 1 mm off.
    #[test]
    fn the_farthest_corner_counts() {
        let known: Rigid<Base, BoardFrame> = Rigid::claim(Isometry3::translation(500.0, 0.0, 0.0));
        let found = known * Rigid::claim(Isometry3::rotation(Vector3::z() * 0.01));
        let corners = [[0.0, 0.0], [100.0, 0.0], [0.0, 60.0]].map(|[x, y]| Point::at(x, y, 0.0));
        assert!((distance_mm(&known, &found, &corners) - 1.0).abs() < 1e-4);
    }
}
