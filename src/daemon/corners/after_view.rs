//! The first corner loop after a view: what its pictures are worth together, and whether another one follows.

use crate::cycle::{Answer, Grade};
use crate::locate::refine::{self, Refined};
use crate::recipe;
use crate::verdict::{Judgement, Reason};
use crate::words::apart;

/// How far the first loop is after a view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loop {
    /// A corner has not been seen yet.
    pub is_missing: bool,
    /// No view follows.
    pub is_last: bool,
    /// How far a corner stands from where it was looked for, at most, mm.
    pub step_mm: f64,
}

impl Loop {
    fn is_settled(self, limits: &recipe::Corner) -> bool {
        self.step_mm <= limits.settled_mm()
    }

    /// All corners have been seen from near.
    pub fn is_done(self, limits: &recipe::Corner) -> bool {
        !self.is_missing && self.is_settled(limits)
    }

    /// What all pictures together are worth; `claims_mm` is what scan and calibrations claim, 95 %, where they do.
    pub fn judged(self, whole: &Refined, claims_mm: Option<[f64; 2]>, limits: &recipe::Corner) -> Judgement {
        // What a corner finds is a finding once all have been seen from near.
        let claims_mm = claims_mm.filter(|_| self.is_done(limits));
        let found = claims_mm.and_then(|claims_mm| refine::disagreement(whole, &claims_mm));
        let moved = (self.is_last && !self.is_settled(limits)).then(|| not_settled(self.step_mm, limits));
        let missing = (self.is_last && self.is_missing).then(|| {
            let message =
                format!("after {} moves, [corner] max_moves, a corner has not been seen", limits.max_moves());
            Reason::new("corner_unseen", message)
        });
        let of_loop = Judgement::of(moved.into_iter().chain(missing).collect(), found.into_iter().collect());
        refine::judge(whole, limits).and(of_loop)
    }

    /// What is rejected is not looked at again from nearer; everything else is, until it is done.
    pub fn answer(self, grade: Grade, limits: &recipe::Corner) -> Answer {
        let goes_on = !self.is_done(limits) && !self.is_last && grade != Grade::Reject;
        if goes_on { Answer::LookOn } else { Answer::Graded(grade) }
    }
}

fn not_settled(step_mm: f64, limits: &recipe::Corner) -> Reason {
    let (settled_mm, moves) = (limits.settled_mm(), limits.max_moves());
    let [step, settled] = apart(step_mm, settled_mm, 2);
    let message = format!(
        "after {moves} moves, [corner] max_moves, a corner still stands {step} mm from where it was looked for, allowed are \
         {settled} mm, settled_mm; is the hand-eye calibration good, does the panel move?"
    );
    Reason::new("not_settled", message)
}
