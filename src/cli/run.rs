//! `panelprep run`: the service of a configured cell.

use super::args::{Common, Run};
use super::assignment::{Assignment, Calibrated};
use super::fault::Fault;
use super::health;
use super::live::Live;
use super::load::{CellFiles, calibrated_serial};
use super::outcome::Outcome;
use super::person::Person;
use super::recording;
use super::report::{self, Kept};
use super::zivid;
use crate::cycle::{At, State};
use crate::daemon::{
    self, Beside, Desk, EndedCycle, Letter, Letters, Loader, Order, RecordIn, Recorded, Recording, Robot as _,
    Service, Site, Socket, Started, StoreRecord, Taped, Taping, WrittenPage,
};
use crate::devices::world::SimulatedWorld;
use crate::requirements::Purpose;
use crate::supervision::Supervisor;
use crate::verdict::{Judgement, Reason, Verdict};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// Serves until a signal ends it. What an earlier process left open is for a person to clear; nothing moves before.
///
/// # Errors
/// Where a file is not what it must be, another process writes to the store or answers on the socket, or the store
/// does not write.
pub fn run(args: &Run, common: &Common) -> Result<Outcome, Fault> {
    let supervisor = Supervisor::default();
    supervisor.notice_panics();
    let (tell, letters) = daemon::letters();
    signals(tell.clone())?;
    let files = Arc::new(CellFiles::read(common)?);
    files.require(Purpose::Cycle)?;
    let site = Site::new(&files.cell).map_err(Fault::stage)?;
    let calibrated = Calibrated::read(&files, common)?;
    let mut store = files.store_for_writing()?;
    let recovered = store.recover().map_err(Fault::stage)?;
    let journal = store.journal().map_err(Fault::stage)?;
    tracing::info!(
        version = env!("CARGO_PKG_VERSION"), cell = %common.cell.display(), events = journal.len(),
        "starts in {}", recovered.at.word()
    );
    let taken_by = cameras_by(&files)?;
    let mut live = Live::start(&files.cell, &calibrated.values, args.simulation)?;
    let world = live.world.clone();
    let taping = Taping::new(files.store_folder(), live.robot.is_lock_step());
    taping.watched_by(&supervisor);
    let path = files.socket();
    supervisor.watch(live.robot.watched());
    let loader = loader((files.clone(), common.clone()), taken_by, world.clone());
    let socket = Socket::listen(&path, tell, loader, &supervisor).map_err(Fault::stage)?;
    tracing::info!("listens on {}", path.display());
    let left_open = store.open_cycles().map_err(Fault::stage)?.pop();
    let (ended, pages) = mpsc::channel();
    let written = WrittenPage::default();
    let pages = write_pages(files.clone(), pages, written.clone())?;
    let beside = Beside { taping: taping.clone(), supervisor: supervisor.clone(), pages: ended, written };
    let desk = Desk::new(letters, left_open, beside);
    let mut person = Person { asks: desk, world };
    let (again, whole) = (files.clone(), common.clone());
    let keep = daemon::keeper(&store).map_err(Fault::stage)?;
    let mut record = StoreRecord::new(&mut store, left_open);
    let service = Service {
        robot: &mut Taped::new(&mut live.robot, taping.clone()),
        eyes: Box::new(Taped::new(Box::new(live.eyes), taping.clone())),
        readable: Box::new(move || Calibrated::read(&again, &whole).err().iter().map(unreadable).collect()),
        keep,
        record: &mut Taped::new(&mut record, taping.clone()),
        requests: &mut Taped::new(&mut person, taping.clone()),
        supervisor,
    };
    let ended = daemon::serve(site, service, journal);
    // One that is still open belongs to a loop that failed: the very one to look at.
    if let Some(recorded) = taping.finish() {
        tracing::info!("{}", recorded.message);
    }
    let ended = ended.map_err(Fault::of_loop)?;
    drop((socket, person));
    // A panic in there was reported where it happened.
    let _ = pages.join();
    tracing::info!("ends in {}", ended.at.word());
    Ok(outcome(&ended))
}

/// Signals come to the desk, however many there are.
fn signals(tell: Letters) -> Result<(), Fault> {
    let mut signals = Signals::new([SIGTERM, SIGINT]).map_err(Fault::stage)?;
    let each = move || {
        for _ in signals.forever() {
            if tell.send(Letter::Signal).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(each).map_err(Fault::stage)?;
    Ok(())
}

/// Writes the page of each cycle that has ended, beside the loop, until nobody tells of more.
fn write_pages(
    files: Arc<CellFiles>,
    ended: Receiver<EndedCycle>,
    written: WrittenPage,
) -> Result<JoinHandle<()>, Fault> {
    let page = move |cycle, recorded: Option<&Recorded>| -> Result<PathBuf, Fault> {
        let page = report::page_file(files.store_folder(), cycle);
        Kept::read(&files.store()?, cycle)?.write(&page, recorded.map(recording::section).into_iter().collect())?;
        Ok(page)
    };
    let each = move || {
        for EndedCycle { id: cycle, recording } in ended {
            let recorded = recording.map(Recording::finish);
            if let Some(Recorded { message, .. }) = &recorded {
                tracing::info!("cycle {cycle}: {message}");
            }
            match page(cycle, recorded.as_ref()) {
                Ok(page) => {
                    written.is(cycle, &page);
                    tracing::info!("page of cycle {cycle}: {}", page.display());
                }
                Err(fault) => tracing::warn!("no page of cycle {cycle}: {fault}"),
            }
        }
    };
    std::thread::Builder::new().name("pages".to_owned()).spawn(each).map_err(Fault::stage)
}

/// What the cameras were started by and hold what comes against: settings, and which cameras were calibrated at which size.
fn cameras_by(files: &CellFiles) -> Result<Vec<(&'static str, String)>, Fault> {
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

/// Reads all that a cycle works by, anew for each one. The cameras go on by what they were started with, so that in the
/// files must be the same.
fn loader(
    (files, common): (Arc<CellFiles>, Common),
    taken_by: Vec<(&'static str, String)>,
    world: Option<SimulatedWorld>,
) -> Arc<Loader> {
    let one_at_a_time = Mutex::new(());
    Arc::new(move |Started { recipe: name, text, record, part }| {
        // A file on a disk that hangs must not take the places of those who ask for a stop.
        let Ok(_turn) = one_at_a_time.try_lock() else {
            return Err(vec![Reason::new("busy", "another start is being read; ask again when it was answered")]);
        };
        let health = health::judge(&files).map_err(|fault| vec![unreadable(&fault)])?;
        if health.verdict == Verdict::Reject {
            return Err(health.reasons);
        }
        let load = || -> Result<_, Fault> {
            if cameras_by(&files)? != taken_by {
                return Err(Fault::CamerasChanged);
            }
            let calibrated = Calibrated::read(&files, &common)?;
            let assignment = Assignment::of(&files, Path::new(&name), text.clone())?.about(part.clone())?;
            if let Some(world) = &world {
                world.mount_disc(assignment.recipe.path().disc_diameter_mm());
            }
            let record = match &record {
                None => None,
                Some(place) => {
                    let file = match place {
                        RecordIn::Store => None,
                        RecordIn::File(file) => Some(recording::named_by_a_client(file, files.store_folder())?),
                    };
                    recording::allowed(file.as_deref(), files.store_folder())?;
                    Some(recording::of(file, &files, (&assignment, &calibrated))?)
                }
            };
            Ok(Order { record, ..assignment.order(&calibrated)? })
        };
        load().map_err(|fault| vec![Reason::new("bad_input", fault.to_string())])
    })
}

fn unreadable(fault: &Fault) -> Reason {
    Reason::new("calibration", fault.to_string())
}

fn outcome(state: &State) -> Outcome {
    let at = state.at;
    let verdict = if at == At::Stopped { Verdict::Accept } else { Verdict::Aborted };
    let reasons = daemon::why(state);
    let mut outcome = Outcome::of(&Judgement { verdict, reasons });
    outcome.put("state", at.word().into());
    outcome.words[0] = format!("ended in state {}", at.word());
    outcome
}
