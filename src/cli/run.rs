//! `panelprep run`: the service of a cell.
//!
//! In a simulated cell, a simulated person dries the panel before a person confirms with `start` or `unhold --dried`
//! that it is dry.

use super::args::{Common, Run};
use super::fault::Fault;
use super::live::CellDevices;
use super::output::Outcome;
use super::simulated::{FollowedRobot, SimulatedPerson};
use panelprep_base::supervision::Supervisor;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{At, Cause, State};
use panelprep_service::daemon::{
    self, Computing, Gateway, Interfaces, LastWrittenPage, LiveView, LoopEvent, LoopPorts, LoopStart, Port,
    RecordedPort, RecordingSwitch, Request, RequestCommand, RequestHandler, RequestQueue, RequestSender,
    Requester as _, ServiceParts, SharedCameras, Socket, StoreRecord,
};
use panelprep_service::requirements::Purpose;
use panelprep_service::setup::{Calibrated, CellFiles, CellSetup, CycleLoader, SetupFault, unreadable_reason};
use panelprep_store::store::{Store, StoreError};
use panelprep_store::tape::LoopMemoryStart;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::sync::{Arc, mpsc};

/// Runs the service of the cell until a signal ends it. If an earlier process has left a motion open, a person must
/// clear it before anything moves.
///
/// # Errors
/// If a file is invalid, another process uses the store or the socket, or the store cannot be written.
pub fn run(args: &Run, common: &Common) -> Result<Outcome, Fault> {
    let supervisor = Supervisor::default();
    supervisor.record_all_panics();
    let (sender, queue) = daemon::request_queue();
    signals(sender.clone())?;
    let files = Arc::new(CellFiles::read(&common.paths())?);
    // Before anything is connected: a service that a line or an office expects must not start without them.
    if let Some(missing) = SetupFault::missing_plant(&files.cell) {
        return Err(missing.into());
    }
    files.require(Purpose::Cycle)?;
    let cell = Arc::new(CellSetup::new(&files.cell)?);
    let calibrated = Calibrated::read(&files)?;
    let Some(mut store) = open_store(&files, (&sender, &queue))? else { return Ok(outcome(&State::INITIAL)) };
    let recovered = store.recover().map_err(Fault::stage)?;
    let (state, events) = (store.state().map_err(Fault::stage)?, store.lines().map_err(Fault::stage)?);
    tracing::info!(
        version = env!("CARGO_PKG_VERSION"), cell = %common.cell.display(), events,
        "starts in {}", recovered.at.keyword()
    );
    let loader = CycleLoader::new(files.clone(), cell.clone())?;
    let mut live = CellDevices::start(&files.cell, &calibrated.values, args.simulation)?;
    if let Some(line) = live.robot.stop_line() {
        sender.set_urgent_line(line);
    }
    let world = live.world.clone();
    let lock_step = live.robot.is_lock_step();
    let recording = RecordingSwitch::new(files.store_folder(), lock_step);
    recording.watched_by(&supervisor);
    let path = files.socket();
    supervisor.add_thread(live.robot.supervision_handle());
    live.tool_watched.iter().for_each(|watched| supervisor.add_thread(watched.clone()));
    let cameras = SharedCameras::new(live.cameras, live.robot.last_state());
    let lent = Some(cameras.clone());
    let gateway = Gateway::new(sender, Arc::new(loader.in_world(world.clone())), cameras.clone());
    let view = LiveView::default();
    let socket =
        Socket::listen(&path, files.cell.socket_role(), gateway.clone(), &supervisor).map_err(Fault::stage)?;
    tracing::info!("listens on {}", path.display());
    let interfaces = Interfaces::start(&files, gateway, &live.robot, view.clone())?;
    let left_open = store.open_cycles().map_err(Fault::stage)?.pop();
    let (ended, pages) = mpsc::channel();
    let written = LastWrittenPage::default();
    let pages = daemon::write_pages(files.clone(), pages, written.clone()).map_err(Fault::stage)?;
    let parts = ServiceParts {
        recording: recording.clone(),
        supervisor: supervisor.clone(),
        pages: ended,
        written,
        cameras: lent,
        view: view.clone(),
    };
    let mut handler = RequestHandler::new(queue, left_open, parts);
    // This also applies to a change that an earlier start has detected, until a person has cleared it.
    if recovered.at == (At::Aborted { cause: Cause::StoreChanged }) {
        let found = store.incidents().map_err(Fault::stage)?.pop().map_or(vec![], |incident| incident.found);
        let found: Vec<Reason> = found.into_iter().map(|words| Reason::new("store_changed", words)).collect();
        handler.on_loop_event(LoopEvent::Noted(found));
    }
    let mut requests: Box<dyn Port<RequestCommand>> = match world {
        Some(world) => Box::new(SimulatedPerson { requester: handler, world }),
        None => Box::new(handler),
    };
    let again = files.clone();
    let keep = daemon::picture_store(&store).map_err(Fault::stage)?;
    let mut record = StoreRecord::new(&mut store, left_open);
    let readable = Box::new(move || Calibrated::read(&again).err().iter().map(unreadable_reason).collect());
    let cameras = Box::new(RecordedPort::new(Box::new(cameras), recording.clone()));
    let computing = Computing::on_thread((cameras, readable, keep), lock_step, &supervisor, view.clone())
        .map_err(Fault::from_loop_error)?;
    let robot = FollowedRobot { robot: &mut live.robot, follower: live.follower };
    let ports = LoopPorts {
        robot: &mut RecordedPort::new(Box::new(robot), recording.clone()),
        tool: &mut RecordedPort::new(&mut live.tool, recording.clone()),
        record: &mut RecordedPort::new(&mut record, recording.clone()),
        requests: &mut RecordedPort::new(requests.as_mut(), recording.clone()),
        computing,
        lock_step,
    };
    let ended = daemon::run(LoopStart { cell, cycle: None, state, before: LoopMemoryStart::Boot }, ports);
    // If a recording is still open here, the loop has failed; the recording is finished because it is needed to find
    // the cause.
    if let Some(recorded) = recording.finish() {
        tracing::info!("{}", recorded.message);
    }
    let ended = ended.map_err(Fault::from_loop_error)?;
    // The page's connections to the store end before the store's own connection. The last connection then leaves a
    // database without a write-ahead log.
    drop((socket, interfaces, requests));
    #[expect(clippy::let_underscore_must_use, reason = "a panic in there was reported where it happened")]
    let _ = pages.join();
    let ended = ended.state;
    tracing::info!("the service ends in state {}", ended.at.keyword());
    Ok(outcome(&ended))
}

/// Opens the store. If the disk is full, the service still starts: it replies to requests, refuses them all, reports
/// what to delete, and continues when there is space. `None` if a signal ends the service first.
fn open_store(files: &CellFiles, (sender, queue): (&RequestSender, &RequestQueue)) -> Result<Option<Store>, Fault> {
    let full = match Store::create(files.store_folder()) {
        Err(error @ StoreError::Full { .. }) => error.to_string(),
        opened => return opened.map(Some).map_err(Fault::stage),
    };
    let gateway = Gateway::without_cell(sender.clone(), Reason::new("disk_full", full));
    let socket = Socket::listen(&files.socket(), files.cell.socket_role(), gateway, &Supervisor::default());
    if let Err(error) = &socket {
        tracing::warn!("requests cannot be answered while the disk is full: {error}");
    }
    // Any other error than a full disk ends the waiting.
    let opened = daemon::wait_for(queue, || match Store::create(files.store_folder()) {
        Err(error @ StoreError::Full { .. }) => Err(Reason::new("disk_full", error.to_string())),
        opened => Ok(opened),
    });
    opened.transpose().map_err(Fault::stage)
}

/// Starts a thread that converts each signal to a request.
fn signals(sender: RequestSender) -> Result<(), Fault> {
    let mut signals = Signals::new([SIGTERM, SIGINT]).map_err(Fault::stage)?;
    let each = move || {
        for _ in signals.forever() {
            if sender.send(Request::signal()).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(each).map_err(Fault::stage)?;
    Ok(())
}

fn outcome(state: &State) -> Outcome {
    let at = state.at;
    let verdict = if at == At::Stopped { Verdict::Accept } else { Verdict::Aborted };
    let reasons = daemon::state_reason(state);
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons });
    outcome.add_value("state", at.keyword().into());
    outcome.lines[0] = format!("ended in state {}", at.keyword());
    outcome
}
