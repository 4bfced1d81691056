//! `panelprep cycle` and `panelprep air-run`: runs one cycle on the configured cell, or its path without contact, and
//! exits.
//!
//! The first SIGINT or SIGTERM stops the cycle; the second one aborts it.

use super::args::{Common, Cycle, Simulation};
use super::fault::{DeviceFault, Fault};
use super::live::{self, CellDevices, FlangeLink, SimulatedController};
use super::output::Outcome;
use super::report;
use super::simulated::FollowedRobot;
use panelprep_base::geometry::KukaPose;
use panelprep_base::supervision::{Supervisor, ThreadFault};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{Cell, ProofStage};
use panelprep_cell::cycle::{self, At, Event, Hold, Phase, Refusal, Report, Robot, State, Why};
use panelprep_cell::record::{Answer, RecordingFile, RequestAuthor, RequestRecord, RequestSource, RequestedAction};
use panelprep_devices::robot::StopLine;
use panelprep_service::daemon::{
    self, Computing, LiveView, LoopEvent, LoopOutcome, LoopPorts, LoopStart, RecordPort as _, RecordedPort,
    RecordingSwitch, Request, RequestKind, Requester, StoreRecord, current_user,
};
use panelprep_service::requirements::Purpose;
use panelprep_service::setup::{
    self, Calibrated, Calibrations, CellFiles, RecordingResult, StoredCycle, TaughtRecipe,
};
use panelprep_store::store::CycleStart;
use panelprep_store::tape::LoopMemoryStart;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::register_conditional_default;
use signal_hook::iterator::Signals;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// The result of a cycle that was run.
pub struct CycleRun {
    /// The result of the control loop.
    pub outcome: LoopOutcome,
    /// The cycle as it is stored.
    pub stored: StoredCycle,
    /// The reason if the request was refused.
    pub refusal: Option<Reason>,
    /// The simulated world of a mock robot after the cycle.
    pub simulated: Option<SimulatedController>,
    /// The transfer statistics of the flange camera's pictures, if they are to be reported.
    pub flange_link: Option<FlangeLink>,
    /// The result of the recording, if a recording was requested.
    pub recorded: Option<RecordingResult>,
}

/// A function that starts the devices of the cell.
pub type Start = fn(&Cell, &Calibrations, Simulation) -> Result<CellDevices, Fault>;

/// The parameters for running one cycle.
pub struct Run<'r> {
    /// Starts the devices.
    pub start: Start,
    /// Settings of the simulated devices.
    pub simulation: Simulation,
    /// Creates the request to the control loop.
    pub request: fn(&TaughtRecipe) -> cycle::Request,
    /// The file of the recording, if a recording is requested.
    pub record: Option<&'r Path>,
    /// Counts the signals that stop and abort the cycle.
    pub interrupts: Interrupts,
}

/// Runs one cycle and returns its verdict.
///
/// # Errors
/// If a file is invalid, a stage of the acceptance tests that the motion needs is not signed, the store contains an
/// unfinished motion, or the store cannot be written.
pub fn run(args: &Cycle, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let needed = if args.on_foam { ProofStage::B } else { ProofStage::C };
    run_once(args, common, progress, (TaughtRecipe::request, needed))
}

/// Runs an air-run: the path over all grids, without water, tool and contact.
///
/// # Errors
/// The errors of [`run`].
pub fn air_run(args: &Cycle, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    if args.on_foam {
        return Err(DeviceFault::FoamInTheAir.into());
    }
    run_once(args, common, progress, (TaughtRecipe::air_request, ProofStage::A))
}

fn run_once(
    args: &Cycle,
    common: &Common,
    progress: &dyn Fn(&str),
    (request, needed): (fn(&TaughtRecipe) -> cycle::Request, ProofStage),
) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    files.require(Purpose::Cycle)?;
    live::require_signed(&files.cell, needed)?;
    if let Some(file) = &args.record {
        setup::check_command_file(file, files.store_folder())?;
    }
    let taught_recipe = TaughtRecipe::read(&files, &args.recipe)?.with_part(
        &files,
        Some(args.part.names()),
        args.count.statement(),
    )?;
    let taught_recipe = taught_recipe.on_foam(args.on_foam);
    // An air-run sands nothing, so the maximum number of passes does not apply.
    if matches!(request(&taught_recipe), cycle::Request::Start { .. }) {
        // A sheet of foam is not a part, so there are no names to check.
        if !args.on_foam {
            taught_recipe.check_part_names(&files)?;
        }
        taught_recipe.check_part_passes()?;
    }
    let calibrated = Calibrated::read(&files)?;
    let health = setup::judge_health(&files)?;
    if health.verdict == Verdict::Reject {
        return Ok(unhealthy_outcome(&health));
    }
    if args.new_disc {
        let mut store = files.settled_store()?;
        store.mount_disc().map_err(Fault::stage)?;
        let (wanted, who) = (RequestedAction::NewDisc, Some(current_user()));
        let asked =
            RequestRecord { unix_ms: 0, wanted, who, answer: Some(Answer::Done), reasons: vec![], findings: None };
        store.store_request(&asked, None, None).map_err(Fault::stage)?;
    }
    // The records are signed before the pages are written, because the pages contain the signatures.
    sign(&files, progress);
    setup::make_missing_pages(&files, &|cycle, page| match page {
        Ok(page) => progress(&format!("the missing page of cycle {cycle} was made: {}", page.display())),
        Err(fault) => progress(&format!("the page of cycle {cycle} could not be made: {fault}")),
    })?;
    let interrupts = Interrupts::count_signals()?;
    let record = args.record.as_deref();
    let how = Run { start: CellDevices::start, simulation: args.simulation, request, record, interrupts };
    let ran = run_one(&files, (&taught_recipe, &calibrated), how, progress)?;
    let page = setup::page_file(files.store_folder(), ran.stored.record.id);
    ran.stored.write(files.cell.retention(), &page, ran.recorded.as_ref())?;
    let mut outcome = ran.outcome(ran.judgement());
    outcome.add_line(format!("page: {}", page.display()));
    outcome.add_value("report", json!(page));
    Ok(outcome)
}

/// Signs this cycle and earlier cycles that are not signed. If signing fails, the cycle keeps its result and is signed
/// at the next start.
fn sign(files: &CellFiles, progress: &dyn Fn(&str)) {
    let report = |result: Result<String, String>| progress(&result.unwrap_or_else(|problem| problem));
    if let Err(fault) = setup::sign_missing(files, &report) {
        progress(&format!("the records could not be signed: {fault}"));
    }
}

/// Returns the outcome of a cycle that was not started because the cell is not healthy.
pub fn unhealthy_outcome(health: &Judgement) -> Outcome {
    let mut outcome = Outcome::from_judgement(health);
    outcome.add_line("the cycle did not start; nothing moved");
    outcome.add_value("cycle_id", json!(null));
    outcome.add_value("report", json!(null));
    outcome
}

/// Runs one cycle; the calibrations were already found to be valid.
///
/// # Errors
/// The errors of [`run`].
pub fn run_one(
    files: &CellFiles,
    (taught_recipe, calibrated): (&TaughtRecipe, &Calibrated),
    Run { start, simulation, request, record, interrupts }: Run<'_>,
    progress: &dyn Fn(&str),
) -> Result<CycleRun, Fault> {
    let setup = Arc::new(taught_recipe.single_setup(files, calibrated)?);
    let mut store = files.settled_store()?;
    // `recover` ends the cycle that an earlier process left open. The start of this program is not part of the new
    // cycle.
    store.append(&Event::Reported(Report::Boot), None).map_err(Fault::stage)?;
    store.recover().map_err(Fault::stage)?;

    let mut live = start(&files.cell, &calibrated.values, simulation)?;
    if let Some(line) = live.robot.stop_line() {
        interrupts.set_stop_line(line);
    }
    live.cameras.scanner.wait_warmed_up();
    if let Some(world) = &live.world {
        world.mount_disc(taught_recipe.recipe.path().disc_diameter_mm());
    }
    let named = record.map(|file| RecordingFile::Named(file.display().to_string()));
    let request = request(taught_recipe);
    let is_air_run = matches!(request, cycle::Request::AirRun { .. });
    let start = CycleStart { recording: named, is_air_run, ..taught_recipe.start(calibrated)? };
    let mut once = SingleCycle::new(request, interrupts.clone(), progress);
    let state = store.state().map_err(Fault::stage)?;
    let lock_step = live.robot.is_lock_step();
    let recording = RecordingSwitch::new(files.store_folder(), lock_step);
    if let Some(file) = record {
        let to = setup::plan_recording(Some(file.to_owned()), files, (taught_recipe, calibrated))?;
        recording.begin_recording(file, to, state).map_err(|error| setup::open_refusal(file, error))?;
    }
    // The recording is opened first: if this fails, no cycle is begun that would have to be ended.
    let cycle = store.begin_cycle(&start).map_err(Fault::stage)?;
    let keep = daemon::picture_store(&store).map_err(Fault::stage)?;
    let mut record = StoreRecord::new(&mut store, cycle);
    let supervisor = Supervisor::default();
    let cameras = Box::new(RecordedPort::new(Box::new(live.cameras), recording.clone()));
    let computing = match lock_step {
        true => Computing::inline(cameras, lock_step),
        // The calibrations were read a moment ago, so they are not verified again.
        false => {
            let parts = (cameras as _, Box::new(Vec::new) as _, keep);
            Computing::on_thread(parts, lock_step, &supervisor, LiveView::default()).map_err(Fault::stage)?
        }
    };
    let robot = FollowedRobot { robot: &mut live.robot, follower: live.follower };
    let ports = LoopPorts {
        robot: &mut RecordedPort::new(Box::new(robot), recording.clone()),
        tool: &mut RecordedPort::new(&mut live.tool, recording.clone()),
        record: &mut RecordedPort::new(&mut record, recording.clone()),
        requests: &mut RecordedPort::new(&mut once, recording.clone()),
        computing,
        lock_step,
    };
    let start = LoopStart { cell: setup.cell(), cycle: Some(setup), state, before: LoopMemoryStart::Boot };
    let ended = daemon::run(start, ports);
    interrupts.end_handling();
    // The recording is finished even after a failure, because the events before a failure are the most important ones.
    let recorded = recording.finish();
    let ended = ended.map_err(Fault::from_loop_error)?;
    if let Some(why) = once.not_begun_reason(&ended.state) {
        record.conclude(Verdict::Aborted, vec![why]).map_err(Fault::stage)?;
    }
    let refused = once.refusal;
    drop(store);
    // The cycle is signed before it is read from the store, so that its page contains the signature.
    sign(files, progress);
    Ok(CycleRun {
        outcome: ended,
        stored: StoredCycle::read(&files.store()?, cycle)?,
        refusal: refused,
        simulated: live.simulated,
        flange_link: live.flange_link,
        recorded,
    })
}

impl CycleRun {
    /// Returns the cycle's verdict with its reasons.
    pub fn judgement(&self) -> Judgement {
        let verdict = self.outcome.verdict.unwrap_or(Verdict::Aborted);
        let kept = self.stored.record.judgement.clone();
        kept.unwrap_or(Judgement { verdict, reasons: vec![] })
    }

    /// Returns the outcome of the cycle with this verdict.
    pub fn outcome(&self, judgement: Judgement) -> Outcome {
        let (ended, cycle) = (&self.outcome, self.stored.record.id);
        let mut outcome = Outcome::from_judgement(&judgement);
        outcome.add_line(format!("cycle {cycle}: {}", ended.state.at.keyword()));
        if let Some(why) = &self.refusal {
            outcome.add_line(format!("refused: {}", why.message));
        }
        let passes = report::describe_grids(&self.stored.record);
        if self.stored.record.is_air_run() {
            outcome.add_line("air-run: the panel was neither inspected nor sanded");
        }
        outcome.add_line(format!(
            "abraded: {}",
            if passes.is_empty() { "nothing".to_owned() } else { passes.join(", ") }
        ));
        report::removed(&self.stored.record).iter().for_each(|line| outcome.add_line(line));
        if let Some(recorded) = &self.recorded {
            outcome.add_line(&recorded.message);
            outcome.add_value("recording", json!(recorded));
        }
        let budget = self.stored.record.budget.unwrap_or_default();
        outcome.add_value("cycle_id", json!(cycle.0));
        outcome.add_value("state", json!(ended.state.at.keyword()));
        outcome.add_value("abraded", json!(passes));
        outcome.add_value("removed", report::removed_json(&self.stored.record));
        outcome
            .add_value("base_from_panel", json!(ended.base_from_panel.map(|place| KukaPose::from_rigid(&place))));
        outcome.add_value(
            "budget_mm",
            json!({
                "hand_eye": budget.hand_eye_mm, "locate": budget.locate_mm, "fit": budget.fit_mm,
                "robot": budget.robot_mm, "total": budget.total_mm(),
            }),
        );
        outcome
    }
}

/// Requests one cycle, and ends the loop when the cycle is at rest.
struct SingleCycle<'a> {
    start: cycle::Request,
    request_count: u8,
    /// Whether the state table has accepted the start; from then on the state table ends the cycle.
    is_begun: bool,
    refusal: Option<Reason>,
    /// The last state that the loop reported.
    state: State,
    reported_state: Option<At>,
    interrupts: Interrupts,
    /// Number of signals for which a request was already sent to the state table.
    handled_signals: usize,
    progress: &'a dyn Fn(&str),
}

impl<'a> SingleCycle<'a> {
    fn new(start: cycle::Request, interrupts: Interrupts, progress: &'a dyn Fn(&str)) -> Self {
        let state = State::INITIAL;
        SingleCycle {
            start,
            request_count: 0,
            is_begun: false,
            refusal: None,
            state,
            reported_state: None,
            interrupts,
            handled_signals: 0,
            progress,
        }
    }

    /// Returns the request for the signals received so far: a stop for the first, an abort for the second. If the cell
    /// is at rest, the request ends the loop.
    fn signal_request(&mut self, at: At) -> Option<Option<RequestKind>> {
        let wanted = self.interrupts.count().min(2);
        if wanted == 0 {
            return None;
        }
        if matches!(at, At::Stopped | At::Complete { .. } | At::Aborted { .. }) {
            return Some(Some(RequestKind::Leave));
        }
        if self.handled_signals >= wanted {
            return Some(None);
        }
        self.handled_signals = wanted;
        let (words, request) = match wanted {
            1 => ("stopping the cycle; a second signal aborts the cycle", cycle::Request::Stop),
            _ => ("aborting", cycle::Request::Abort),
        };
        (self.progress)(words);
        Some(Some(RequestKind::Table(request)))
    }

    /// Returns why the cycle never began, so that its record has an end. `None` once the cycle has begun, because then
    /// the state table ends it.
    fn not_begun_reason(&self, state: &State) -> Option<Reason> {
        if self.is_begun {
            return None;
        }
        Some(match &self.refusal {
            _ if self.interrupts.count() > 0 => {
                Reason::new("stopped", "stopped by a signal before the cycle began")
            }
            Some(why) => why.clone(),
            None => daemon::refusal(self.start, Refusal::Robot(state.facts.robot), state),
        })
    }
}

impl Requester for SingleCycle<'_> {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        if self.reported_state.replace(state.at) != Some(state.at) {
            (self.progress)(&describe_state(state.at));
        }
        self.state = *state;
        self.is_begun |= state.job.running;
        if let Some(what) = self.signal_request(state.at) {
            return Ok(what.map(|what| Request::new(what, RequestAuthor::from_source(RequestSource::Signal))));
        }
        let asked = self.request_count;
        let mut ask = |request| {
            self.request_count += 1;
            Some(RequestKind::Table(request))
        };
        let what = match (state.at, asked) {
            (At::Stopped, 0) if state.facts.robot == Robot::Ready => ask(cycle::Request::Reset),
            (At::Idle, 1) => ask(self.start),
            (At::Idle, 2) if self.refusal.is_some() => ask(cycle::Request::Stop),
            // If a person would have to decide or to correct something, this command stops the cycle, because no
            // person can answer it.
            (At::Held(_), 2) => ask(cycle::Request::Stop),
            (At::Stopped, 0) if state.facts.robot == Robot::Unknown => None,
            (At::Stopped | At::Complete { .. } | At::Aborted { .. }, _) => Some(RequestKind::Leave),
            _ => None,
        };
        Ok(what.map(|what| Request::new(what, current_user())))
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        self.refusal = news.refusal_reason(&self.state).or(self.refusal.take());
    }
}

/// Returns a text with the current state, for the terminal.
fn describe_state(at: At) -> String {
    let why = |hold: Hold| match hold.why {
        Why::Asked => "requested by a person",
        Why::Review => "a person must review the result",
        Why::NotVerified => "the panel is not at its located pose",
        Why::TokenOver => "the localization is too old",
        Why::Drying => "the panel must be dried for a new dry picture",
        Why::Trouble(_) => "a fault",
    };
    match at {
        At::Execute(phase) => match phase {
            Phase::Locate => "locating the panel by a 3D scan".to_owned(),
            Phase::Refine { moves } => format!("taking pictures of the corner, picture {}", moves + 1),
            Phase::Dry => "taking the picture of the dry panel".to_owned(),
            Phase::Wet => "wetting the panel".to_owned(),
            Phase::Inspect => "observing the film".to_owned(),
            Phase::Plan => "planning the path over the failed grids".to_owned(),
            Phase::Verify => "verifying the corner before contact".to_owned(),
            Phase::Abrade => "abrading".to_owned(),
            Phase::Retract => "retracting the tool from the panel".to_owned(),
            Phase::Assess { .. } => "grading the executed path".to_owned(),
            Phase::Rinse => "rinsing".to_owned(),
        },
        At::Holding(hold) | At::Held(hold) => format!("{}: {}", at.keyword(), why(hold)),
        At::Completing { verdict } | At::Complete { verdict } => format!("{}: {}", at.keyword(), verdict.keyword()),
        at => at.keyword().to_owned(),
    }
}

/// Counts SIGINT and SIGTERM. Clones share the same count.
#[derive(Debug, Clone, Default)]
pub struct Interrupts {
    count: Arc<AtomicUsize>,
    is_ended: Arc<AtomicBool>,
    stop_line: Arc<OnceLock<StopLine>>,
}

impl Interrupts {
    /// Starts to count the signals, which then no longer end the program.
    ///
    /// # Errors
    /// If the operating system cannot start a thread or install a signal handler.
    pub fn count_signals() -> Result<Self, Fault> {
        let interrupts = Interrupts::default();
        for signal in [SIGINT, SIGTERM] {
            register_conditional_default(signal, interrupts.is_ended.clone()).map_err(Fault::stage)?;
        }
        let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(Fault::stage)?;
        let watched = interrupts.clone();
        let each = move || {
            for _ in signals.forever() {
                // The signal is counted before the robot is stopped, so that the loop knows the cause when the robot
                // reports its stop.
                watched.count.fetch_add(1, Ordering::SeqCst);
                if let Some(line) = watched.stop_line.get() {
                    line.stop();
                }
            }
        };
        std::thread::Builder::new().name("signals".to_owned()).spawn(each).map_err(Fault::stage)?;
        Ok(interrupts)
    }

    /// Sets the handle by which each signal stops the robot immediately, even while the loop waits for its disk. Only
    /// the first handle that is set is used.
    pub fn set_stop_line(&self, line: StopLine) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the stop line is set only once, because a program controls one robot"
        )]
        let _ = self.stop_line.set(line);
    }

    /// Returns the number of signals received.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::SeqCst)
    }

    /// Simulates one signal.
    #[cfg(test)]
    pub fn count_one_signal(&self) {
        self.count.fetch_add(1, Ordering::SeqCst);
    }

    /// Ends the counting once the robot is no longer in use: from now on a signal ends the program immediately.
    pub fn end_handling(&self) {
        self.is_ended.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cycle::{Event, Report, step};

    fn next(once: &mut SingleCycle<'_>, state: &State) -> Option<RequestKind> {
        once.next_request(state).expect("no thread").map(|request| request.what)
    }

    fn signal(interrupts: &Interrupts) {
        interrupts.count_one_signal();
    }

    /// Ctrl-C during the cycle stops it, a second one aborts it, and a third one has no effect. The command exits when
    /// the cell is at rest. Before the cycle has begun, a signal prevents its start.
    #[test]
    fn a_signal_stops_and_a_second_one_aborts() {
        let interrupts = Interrupts::default();
        let start = cycle::Request::AirRun { max_moves: 2 };
        let mut once = SingleCycle::new(start, interrupts.clone(), &|_| {});
        let ready = step(State::INITIAL, Event::Reported(Report::Robot(Robot::Ready))).0;
        let works = State { at: At::Execute(Phase::Abrade), ..ready };
        assert!(next(&mut once, &works).is_none());
        for wanted in [Some(cycle::Request::Stop), Some(cycle::Request::Abort), None] {
            signal(&interrupts);
            let asked = match next(&mut once, &works) {
                Some(RequestKind::Table(request)) => Some(request),
                None => None,
                other => panic!("{other:?}"),
            };
            assert_eq!(asked, wanted);
            assert!(next(&mut once, &works).is_none(), "each signal asks once");
        }
        assert!(matches!(next(&mut once, &State { at: At::Stopped, ..ready }), Some(RequestKind::Leave)));

        let mut once = SingleCycle::new(start, interrupts, &|_| {});
        assert!(matches!(next(&mut once, &ready), Some(RequestKind::Leave)), "no reset, no start");
        let why = once.not_begun_reason(&ready).expect("it has an end");
        assert_eq!((&*why.code, once.request_count), ("stopped", 0));
    }

    /// If the selector switch is set to remote, the start is not permitted, the cell is stopped, and the reason is
    /// recorded.
    #[test]
    fn a_start_that_is_not_permitted_ends_with_its_reason() {
        let start = cycle::Request::Start { max_passes: 1, max_moves: 1, dries: false };
        let mut once = SingleCycle::new(start, Interrupts::default(), &|_| {});
        let ready = step(State::INITIAL, Event::Reported(Report::Robot(Robot::Ready))).0;
        let idle = State { at: At::Idle, ..ready };
        let mut asks = |state: &State, refused: Option<&'static str>| {
            let what = next(&mut once, state);
            if let Some(code) = refused {
                once.on_loop_event(LoopEvent::NotPermitted(vec![Reason::new(code, "set the switch to local")]));
            }
            (what, once.not_begun_reason(state).map(|why| why.code.to_string()))
        };
        assert!(matches!(asks(&ready, None).0, Some(RequestKind::Table(cycle::Request::Reset))));
        let (what, why) = asks(&idle, Some("local_control"));
        assert!(matches!(what, Some(RequestKind::Table(asked)) if asked == start));
        assert_eq!(why.as_deref(), Some("local_control"));
        assert!(
            matches!(asks(&idle, None).0, Some(RequestKind::Table(cycle::Request::Stop))),
            "it does not wait for ever"
        );
        let (what, why) = asks(&ready, None);
        assert!(matches!(what, Some(RequestKind::Leave)) && why.as_deref() == Some("local_control"));
    }

    #[test]
    fn a_cycle_that_never_began_states_why() {
        let mut once = SingleCycle::new(
            cycle::Request::Start { max_passes: 1, max_moves: 1, dries: false },
            Interrupts::default(),
            &|_| {},
        );
        let lost = step(State::INITIAL, Event::Reported(Report::Robot(Robot::LinkLost))).0;
        assert!(matches!(next(&mut once, &lost), Some(RequestKind::Leave)));
        assert_eq!(once.not_begun_reason(&lost).map(|why| why.code.to_string()).as_deref(), Some("link_lost"));
        let mut runs = State { at: At::Starting, ..lost };
        runs.job.running = true;
        next(&mut once, &runs);
        assert_eq!(once.not_begun_reason(&lost), None, "the table concludes it");
    }
}
