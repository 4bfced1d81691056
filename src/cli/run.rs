//! `panelprep run`: the service of a cell.
//!
//! In a simulated cell, a simulated person dries the panel before a person confirms with `start` or `unhold --dried`
//! that it is dry.

use super::args::{Common, CountArguments, Run};
use super::cycle_files::{self, Calibrated, TaughtRecipe};
use super::fault::{DeviceFault, Fault, RecordFault};
use super::interfaces::{SharedInterfaceParts, line_front, operator_page, plant_connections, push_sender};
use super::live::CellDevices;
use super::load::{CellFiles, calibrated_serial};
use super::output::Outcome;
use super::report::{self, StoredCycle};
use super::simulated::{FollowedRobot, SimulatedPerson};
use super::{disk, record, recording, zivid};
use panelprep_base::supervision::Supervisor;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{At, Cause, State};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::{CycleId, RecordingFile};
use panelprep_devices::world::SimulatedWorld;
use panelprep_service::daemon::{
    self, CellSetup, Computing, EndedCycle, Gateway, LastWrittenPage, LiveView, Loader, LoopEvent, LoopPorts,
    LoopStart, Port, PreparedCycle, RecipeTextPermission, RecordIn, RecordedPort, Recording, RecordingResult,
    RecordingSwitch, Request, RequestCommand, RequestHandler, RequestQueue, RequestSender, Requester as _,
    ServiceParts, SharedCameras, Socket, StartRequest, StoreRecord,
};
use panelprep_service::requirements::Purpose;
use panelprep_store::store::{PrunedFiles, Store, StoreError};
use panelprep_store::tape::LoopMemoryStart;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

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
    let files = Arc::new(CellFiles::read(common)?);
    // This is checked before anything is connected: a service whose cell file names a production line or an office
    // server must not start without them.
    if let Some(missing) = DeviceFault::missing_plant(&files.cell) {
        return Err(missing.into());
    }
    files.require(Purpose::Cycle)?;
    let cell = Arc::new(CellSetup::new(&files.cell).map_err(Fault::stage)?);
    let calibrated = Calibrated::read(&files, common)?;
    let Some(mut store) = open_store(&files, (&sender, &queue))? else { return Ok(outcome(&State::INITIAL)) };
    let recovered = store.recover().map_err(Fault::stage)?;
    let (state, events) = (store.state().map_err(Fault::stage)?, store.lines().map_err(Fault::stage)?);
    tracing::info!(
        version = env!("CARGO_PKG_VERSION"), cell = %common.cell.display(), events,
        "starts in {}", recovered.at.keyword()
    );
    let taken_by = camera_start_data(&files)?;
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
    let loader = cycle_loader((files.clone(), common.clone()), (cell.clone(), taken_by), world.clone());
    let cameras = SharedCameras::new(live.cameras, live.robot.last_state());
    let lent = Some(cameras.clone());
    let gateway = Gateway::new(sender, loader, lent.clone());
    let view = LiveView::default();
    let socket =
        Socket::listen(&path, files.cell.socket_role(), gateway.clone(), &supervisor).map_err(Fault::stage)?;
    tracing::info!("listens on {}", path.display());
    let fronts = SharedInterfaceParts::new((&files, common), gateway);
    let page = operator_page(&files, &fronts, view.clone())?;
    let push = push_sender(&files, &fronts)?;
    let plant = plant_connections(&files, &fronts)?;
    let line = line_front(&files, &fronts, &live.robot)?;
    let left_open = store.open_cycles().map_err(Fault::stage)?.pop();
    let (ended, pages) = mpsc::channel();
    let written = LastWrittenPage::default();
    let pages = write_pages(files.clone(), pages, written.clone())?;
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
    let (again, whole) = (files.clone(), common.clone());
    let keep = daemon::picture_store(&store).map_err(Fault::stage)?;
    let mut record = StoreRecord::new(&mut store, left_open);
    let readable = Box::new(move || Calibrated::read(&again, &whole).err().iter().map(unreadable_reason).collect());
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
    drop((socket, page, push, plant, line, fronts, requests));
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
    let refuse: Arc<Loader> = Arc::new(move |_: StartRequest| Err(vec![Reason::new("disk_full", full.clone())]));
    let gateway = Gateway::new(sender.clone(), refuse, None);
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

/// Writes the page of each ended cycle, in parallel to the control loop, until the channel is closed.
fn write_pages(
    files: Arc<CellFiles>,
    ended: Receiver<EndedCycle>,
    written: LastWrittenPage,
) -> Result<JoinHandle<()>, Fault> {
    let again = files.clone();
    let page = move |cycle, recorded: Option<&RecordingResult>| -> Result<PathBuf, Fault> {
        let page = report::page_file(files.store_folder(), cycle);
        StoredCycle::read(&files.store()?, cycle)?.write(files.cell.retention(), &page, recorded)?;
        Ok(page)
    };
    let each = move || {
        // The records are signed before the pages are written, because the pages contain the signatures.
        sign(&again);
        if let Err(fault) = report::make_missing_pages(&again, &log_page) {
            tracing::warn!(
                "missing pages of earlier cycles could not be written: {fault}; write a page with `panelprep page N`"
            );
        }
        prune(&again);
        for EndedCycle { id: cycle, recording } in ended {
            let recorded = recording.map(Recording::finish);
            if let Some(RecordingResult { message, .. }) = &recorded {
                tracing::info!("cycle {cycle}: {message}");
            }
            sign(&again);
            let made = page(cycle, recorded.as_ref());
            if let Ok(page) = &made {
                written.set_page(cycle, page);
            }
            log_page(cycle, made);
            prune(&again);
            daemon::give_back_free_memory();
        }
    };
    std::thread::Builder::new().name("pages".to_owned()).spawn(each).map_err(Fault::stage)
}

fn log_page(cycle: CycleId, page: Result<PathBuf, Fault>) {
    match page {
        Ok(page) => tracing::info!("page of cycle {cycle}: {}", page.display()),
        Err(fault) => tracing::warn!(
            "the page of cycle {cycle} could not be made: {fault}; make it with `panelprep page {cycle}`"
        ),
    }
}

/// Signs each ended cycle that is not signed; after a failure this is repeated after the next cycle.
fn sign(files: &CellFiles) {
    let report = |result: Result<String, String>| match result {
        Ok(words) => tracing::info!("{words}"),
        Err(problem) => tracing::warn!("{problem}"),
    };
    if let Err(fault) = record::sign_missing(files, &report) {
        tracing::warn!("the records could not be signed: {fault}; this is repeated after the next cycle");
    }
}

/// Deletes files whose retention time has passed; after a failure this is repeated after the next cycle.
fn prune(files: &CellFiles) {
    match Store::prune(files.store_folder(), files.cell.retention()) {
        Ok(PrunedFiles { files: 0, .. }) => {}
        Ok(PrunedFiles { files, bytes, .. }) => {
            tracing::info!(
                "{files} files of old clips and scans were removed, {} MB, by the rules of [store] keep",
                bytes / 1_000_000
            );
        }
        Err(error) => tracing::warn!(
            "old clips and scans could not be removed: {error}; this is repeated after the next cycle"
        ),
    }
}

/// Returns the data with which the cameras were started: their settings, and the serial number and picture size of each
/// calibrated camera. The files must contain the same data in each cycle.
fn camera_start_data(files: &CellFiles) -> Result<Vec<(&'static str, String)>, Fault> {
    let mut all = zivid::settings(&files.cell)?;
    let calibration = files.cell.calibration();
    let lenses = [
        ("scanner", files.scanner()?, &calibration.scanner),
        ("flange_camera", files.flange_camera()?, &calibration.flange_camera),
    ];
    for (which, lens, file) in lenses {
        let size_px = [lens.value.width_px, lens.value.height_px];
        let serial = calibrated_serial(file.as_deref())?.unwrap_or_default();
        all.push((which, format!("{serial} {}×{}", size_px[0], size_px[1])));
    }
    Ok(all)
}

/// Returns a function that reads all data of a cycle; it is called for each cycle. The files must contain the data with
/// which the cameras were started.
fn cycle_loader(
    (files, common): (Arc<CellFiles>, Common),
    (cell, taken_by): (Arc<CellSetup>, Vec<(&'static str, String)>),
    world: Option<SimulatedWorld>,
) -> Arc<Loader> {
    let one_at_a_time = Mutex::new(());
    Arc::new(move |request: StartRequest| {
        let StartRequest { recipe: name, text, record, part, another_part, lost_passes, is_stated_clear, own_text } =
            request;
        // Only one start at a time reads files, so that a disk that hangs does not block the clients that request a
        // stop.
        let Ok(_turn) = one_at_a_time.try_lock() else {
            return Err(vec![Reason::new(
                "busy",
                "another start request is being processed; try again after the service has answered it",
            )]);
        };
        let health = cycle_files::judge_health(&files).map_err(|fault| vec![unreadable_reason(&fault)])?;
        if health.verdict == Verdict::Reject {
            return Err(health.reasons);
        }
        let foreign = foreign_recipe(files.cell.page().recipes.as_path(), (&name, &text));
        if let (Some(foreign), RecipeTextPermission::Refused) = (&foreign, own_text) {
            return Err(vec![not_permitted_refusal(foreign)]);
        }
        let load = || -> Result<_, Fault> {
            if camera_start_data(&files)? != taken_by {
                return Err(DeviceFault::CamerasChanged.into());
            }
            let calibrated = Calibrated::read(&files, &common)?;
            let taught_recipe = TaughtRecipe::from_text(&files, Path::new(&name), text.clone())?;
            let taught_recipe =
                taught_recipe.with_part(&files, part.clone(), CountArguments { another_part, lost_passes })?;
            taught_recipe.check_part_names(&files)?;
            if let Some(world) = &world {
                world.mount_disc(taught_recipe.recipe.path().disc_diameter_mm());
            }
            let named = record.as_ref().map(|place| match place {
                RecordIn::Store => RecordingFile::InStore,
                RecordIn::File(file) => RecordingFile::Named(file.display().to_string()),
            });
            let record = match &record {
                None => None,
                Some(place) => {
                    let file = match place {
                        RecordIn::Store => None,
                        RecordIn::File(file) => Some(recording::check_client_file(file, files.store_folder())?),
                    };
                    recording::check_recording_file(file.as_deref(), files.store_folder())?;
                    Some(recording::plan(file, &files, (&taught_recipe, &calibrated))?)
                }
            };
            let mut prepared =
                PreparedCycle { recording: record, ..taught_recipe.prepare_cycle(cell.clone(), &calibrated)? };
            prepared.start.recording = named;
            prepared.remarks.extend(foreign.clone());
            prepared.remarks.extend(is_stated_clear.then(stated_clear_remark));
            Ok(prepared)
        };
        load().map_err(|fault| {
            let code = match fault {
                Fault::Record(RecordFault::PartUsedUp { .. }) => "part_used_up",
                Fault::Record(RecordFault::CountUnknown(_)) => "count_unknown",
                Fault::Record(RecordFault::PartNames(_)) => "part_name",
                _ => "bad_input",
            };
            vec![Reason::new(code, fault.to_string())]
        })
    })
}

/// Returns the remark in the record of a start if the person stated that the cell is clear.
fn stated_clear_remark() -> Reason {
    let message =
        "the person who started the cycle stated that the guard is closed and no person is inside the cell";
    Reason::new("stated_clear", message)
}

/// Returns a reason if the text of a recipe differs from the file with this name in the folder of recipes.
fn foreign_recipe(folder: &Path, (name, text): (&str, &str)) -> Option<Reason> {
    let file = folder.join(Path::new(name).file_name().unwrap_or_default());
    let there = disk::read_text(&file).ok();
    let found = match &there {
        Some(there) if there == text => return None,
        Some(there) => format!("the file in the folder has SHA-256 {}", content_hash(there.as_bytes())),
        None => "the folder contains no such file".to_owned(),
    };
    let message = format!(
        "the recipe {name} with SHA-256 {} is not in the folder {}: {found}",
        content_hash(text.as_bytes()),
        folder.display()
    );
    Some(Reason::new("foreign_recipe", message))
}

/// Returns the refusal for an operator, who may start cycles only with the recipes that an engineer has put into the
/// folder.
fn not_permitted_refusal(foreign: &Reason) -> Reason {
    let message = format!(
        "{}. The role operator may start only recipes of this folder; ask an engineer to put the recipe there or to start the cycle",
        foreign.message
    );
    Reason { message, ..foreign.clone() }
}

fn unreadable_reason(fault: &Fault) -> Reason {
    Reason::new("calibration", fault.to_string())
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A recipe in the folder is recognised by its name and its whole text; another text with the same name is another
    /// recipe.
    #[test]
    fn a_recipe_of_the_folder_is_recognised_by_name_and_text() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("door.toml"), "min_break_mm2 = 25\n").expect("written");
        let foreign = |name: &str, text: &str| foreign_recipe(folder.path(), (name, text));
        assert_eq!(foreign("door.toml", "min_break_mm2 = 25\n"), None);
        assert_eq!(foreign("/etc/panelprep/recipes/door.toml", "min_break_mm2 = 25\n"), None, "by its whole name");
        let own = foreign("door.toml", "min_break_mm2 = 10000\n").expect("another text");
        let sha256 = content_hash(b"min_break_mm2 = 25\n");
        assert!(own.code == "foreign_recipe" && own.message.contains(&sha256), "{}", own.message);
        for (name, text) in [("gate.toml", "min_break_mm2 = 25\n"), ("..", ""), ("", ""), ("door.toml/", "")] {
            assert!(foreign(name, text).is_some(), "{name}");
        }
        assert!(not_permitted_refusal(&own).message.contains("role operator"));
    }
}
