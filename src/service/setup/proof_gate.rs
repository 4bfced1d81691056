//! Acceptance tests: a real controller moves in automatic mode only after the required stage of its acceptance tests is
//! signed.
//!
//! This is the only place where the program decides this. The loop checks it before each start and before each motion,
//! for all interfaces, and the single functions check it before each motion. Whether the controller is a mock
//! controller is determined from its own state and not from its address. A controller that has not reported yet is
//! treated as a real one.

use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{self, ProofStage};
use panelprep_cell::cycle::{Path, Request};
use panelprep_kuka::eki::State;

/// Decides whether the signed acceptance tests permit a motion.
#[derive(Debug, Clone, PartialEq)]
pub enum ProofGate {
    /// The controller in the cell's file, with the newest signed page of its acceptance tests.
    Controller(cell::Robot),
    /// A replay of a recorded cycle, which moves no robot; the motions were permitted when the cycle was recorded.
    Replay,
}

impl ProofGate {
    /// Returns the reason why a motion that requires this stage is refused; `None` if it is permitted.
    pub fn refusal(&self, needed: ProofStage, state: Option<&State>) -> Option<Reason> {
        let ProofGate::Controller(robot) = self else { return None };
        refusal(robot, needed, state)
    }
}

/// Returns why this controller must not execute a motion that requires this stage; `None` if it may. `state` is the
/// last state that the controller reported.
pub(crate) fn refusal(robot: &cell::Robot, needed: ProofStage, state: Option<&State>) -> Option<Reason> {
    if state.is_some_and(State::is_simulated) {
        return None;
    }
    let unsigned = robot.check_stage_signed(needed).err()?;
    Some(Reason::new("stage_not_signed", unsigned.to_string()))
}

/// Returns the stage that a motion in automatic mode requires.
pub(crate) fn stage_of_motion(path: Path, on_foam: bool) -> ProofStage {
    match path {
        Path::Contact if on_foam => ProofStage::B,
        Path::Contact => ProofStage::C,
        _ => ProofStage::A,
    }
}

/// Returns the stage that the start of a cycle requires; `None` for a request that starts no cycle.
pub(crate) fn stage_of_request(request: Request, on_foam: bool) -> Option<ProofStage> {
    match request {
        Request::Start { .. } => Some(stage_of_motion(Path::Contact, on_foam)),
        Request::AirRun { .. } => Some(ProofStage::A),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::testing::standing_state;
    use panelprep_cell::cell::{Cell, SignedPage};

    /// Boot ID from the clock of a real controller: 26 years after 2000, in seconds.
    const REAL_BOOT: i32 = 820_000_000;

    fn robot(host: &str, signed: Option<ProofStage>) -> cell::Robot {
        let stated = signed.map_or(String::new(), |stage| format!("signed_stage = '{}'\n", stage.letter()));
        let text = format!("[robot]\nkind = 'eki'\nhost = '{host}'\nprograms_sum = 7\n{stated}");
        let page = signed.map(|stage| SignedPage { stage, programs_sum: 7, wrong_since: None });
        Cell::check("cell.toml", &text).expect("good").with_signed_page(page).robot().clone()
    }

    /// A tunnel to a real controller has an address on this computer; only the reported state shows that the controller
    /// is real.
    #[test]
    fn a_local_address_alone_permits_no_motion() {
        let [mock, real, not_begun] = [1, REAL_BOOT, 0].map(cell_state);
        for host in ["127.0.0.1", "localhost", "172.31.1.147"] {
            let unsigned = robot(host, None);
            assert_eq!(refusal(&unsigned, ProofStage::C, Some(&mock)), None, "{host}");
            for state in [Some(&real), Some(&not_begun), None] {
                let why = refusal(&unsigned, ProofStage::A, state).expect("refused");
                assert_eq!(why.code, "stage_not_signed", "{host} {state:?}");
            }
        }
    }

    fn cell_state(boot: i32) -> State {
        State { boot, ..standing_state() }
    }

    #[test]
    fn each_path_needs_its_stage() {
        use ProofStage::{A, B, C};
        let state = cell_state(REAL_BOOT);
        let start = Request::Start { max_passes: 1, max_moves: 1, dries: false };
        for (signed, on_foam, permitted) in [
            (None, false, [false, false, false, false]),
            (Some(A), false, [true, false, true, false]),
            (Some(A), true, [true, false, true, false]),
            (Some(B), false, [true, false, true, false]),
            (Some(B), true, [true, true, true, true]),
            (Some(C), false, [true, true, true, true]),
        ] {
            let gate = ProofGate::Controller(robot("krc", signed));
            let needed = [
                stage_of_motion(Path::Park, on_foam),
                stage_of_motion(Path::Contact, on_foam),
                stage_of_request(Request::AirRun { max_moves: 1 }, on_foam).expect("a start"),
                stage_of_request(start, on_foam).expect("a start"),
            ];
            let found = needed.map(|needed| gate.refusal(needed, Some(&state)).is_none());
            assert_eq!(found, permitted, "{signed:?} {on_foam}");
            assert_eq!(ProofGate::Replay.refusal(C, Some(&state)), None);
        }
        assert_eq!(stage_of_request(Request::Stop, false), None);
    }
}
