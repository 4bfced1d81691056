//! `panelprep clear`: clears an abort in a cell that runs without a service.
//!
//! It sends the state table the same request as `panelprep ctl clear` sends to a service, and exits when the cell
//! is at rest again. So the same conditions apply: the robot answers and is at standstill, and tool and water are
//! proven off.

use super::args::Common;
use super::fault::Fault;
use super::live::robot_alone;
use super::load::CellFiles;
use super::outcome::Outcome;
use panelprep_base::supervision::{Supervisor, ThreadFault};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{self, At, Robot, State};
use panelprep_service::daemon::{
    self, CellSetup, Computing, LinkedTool, LoopEvent, LoopPorts, LoopStart, NoCameras, Request, RequestKind,
    Requester, StoreRecord, current_user,
};
use panelprep_store::tape::LoopMemoryStart;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A robot that sends nothing for this time is not connected.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);

/// Confirms that the cause of the last abort is removed.
///
/// # Errors
/// If a file is invalid, there is no store, a service uses the store, or the store cannot be written.
pub fn run(common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let cell = Arc::new(CellSetup::new(&files.cell).map_err(Fault::stage)?);
    // If no store exists, there is nothing to clear, and no store is created.
    drop(files.store()?);
    let mut store = files.store_for_writing()?;
    let recovered = store.recover().map_err(Fault::stage)?;
    if !matches!(recovered.at, At::Aborted { .. }) {
        let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
        outcome.add_line("the last cycle in this store was not aborted; nothing to clear");
        outcome.add_value("state", recovered.at.keyword().into());
        return Ok(outcome);
    }
    let state = store.state().map_err(Fault::stage)?;
    let (mut robot, _simulated) = robot_alone(&files.cell)?;
    let supervisor = Supervisor::default();
    supervisor.add_thread(robot.supervision_handle());
    let lock_step = robot.is_lock_step();
    let mut record = StoreRecord::new(&mut store, None);
    let mut clears = ClearRequester::new(supervisor);
    let ports = LoopPorts {
        robot: &mut robot,
        tool: &mut LinkedTool::default(),
        record: &mut record,
        requests: &mut clears,
        computing: Computing::inline(Box::new(NoCameras), lock_step),
        lock_step,
    };
    let start = LoopStart { cell, cycle: None, state, before: LoopMemoryStart::Boot };
    let ended = daemon::run(start, ports).map_err(Fault::from_loop_error)?.state;
    Ok(outcome(&ended, clears.refusal))
}

fn outcome(ended: &State, refused: Option<Reason>) -> Outcome {
    let at = ended.at;
    let is_clear = at == At::Stopped;
    let reasons = if is_clear { vec![] } else { refused.into_iter().chain(daemon::state_reason(ended)).collect() };
    let verdict = if is_clear { Verdict::Accept } else { Verdict::Aborted };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons });
    outcome.add_value("state", at.keyword().into());
    outcome.lines[0] = match is_clear {
        true => "cleared: the robot is stopped, tool and water are off; the next cycle may start".to_owned(),
        false => format!("not cleared, the cell is {}", at.keyword()),
    };
    outcome
}

/// Requests a clear when the robot has answered, and exits when the cell is at rest after that.
struct ClearRequester {
    supervisor: Supervisor,
    started: Instant,
    is_requested: bool,
    refusal: Option<Reason>,
    /// The state that the loop last showed.
    state: State,
}

impl ClearRequester {
    fn new(supervisor: Supervisor) -> Self {
        ClearRequester {
            supervisor,
            started: Instant::now(),
            is_requested: false,
            refusal: None,
            state: State::INITIAL,
        }
    }
}

impl Requester for ClearRequester {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        self.state = *state;
        self.supervisor.check_threads()?;
        let is_there = !matches!(state.facts.robot, Robot::Unknown | Robot::LinkLost);
        let what = match (state.at, self.is_requested) {
            (at, true) if at.is_at_rest() => Some(RequestKind::Leave),
            (At::Aborted { .. }, false) if is_there || self.started.elapsed() >= CONNECT_TIMEOUT => {
                self.is_requested = true;
                Some(RequestKind::Table(cycle::Request::Clear))
            }
            _ => None,
        };
        Ok(what.map(|what| Request::new(what, current_user())))
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        self.refusal = news.refusal_reason(&self.state).or(self.refusal.take());
    }
}
