//! Whether the proofs that a single motion needs are signed.

use crate::cell::{Cell, ProofStage};
use crate::daemon::SingleError;
use crate::eki::Mode;
use crate::verdict::{Judgement, Reason};

/// Refuses a motion in automatic mode until stage A of the proofs is signed. In T1 a person holds the enabling switch, and
/// a mock controller moves no arm.
///
/// # Errors
/// If it is not signed.
pub fn permits_motion(mode: Mode, is_mock: bool, cell: &Cell) -> Result<(), SingleError> {
    let is_by_hand = matches!(mode, Mode::T1 | Mode::T2);
    match cell.robot().requires_signed(ProofStage::A) {
        Err(unsigned) if !is_by_hand && !is_mock => {
            let reason = Reason::new("stage_not_signed", unsigned.to_string());
            Err(SingleError::Gate(Judgement::new(vec![reason], vec![])))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A real controller without a signed stage moves in T1 alone.
    #[test]
    fn a_motion_in_automatic_mode_needs_stage_a() {
        let cell =
            |robot: &str| Cell::check("cell.toml", &format!("[robot]\nkind = 'eki'\n{robot}")).expect("good");
        let real = cell("host = 'krc'");
        for (mode, is_mock, cell, permitted) in [
            (Mode::T1, false, &real, true),
            (Mode::Automatic, false, &real, false),
            (Mode::External, false, &real, false),
            (Mode::External, true, &real, true),
            (Mode::Automatic, false, &cell("host = 'krc'\nsigned_stage = 'A'"), true),
        ] {
            let judged = permits_motion(mode, is_mock, cell);
            assert_eq!(judged.is_ok(), permitted, "{mode:?} {is_mock}: {judged:?}");
            if let Err(SingleError::Gate(judgement)) = judged {
                assert_eq!(judgement.reasons[0].code, "stage_not_signed");
            }
        }
    }
}
