//! The handshake with a production line by digital signals of the robot's controller. Ten times a second, a thread
//! reads the inputs and the state of the cell, sets the outputs, and sends the requests that `panelprep_cell::line`
//! decides. It uses the gateway like every interface. The loop never waits for this thread. If the thread does not run,
//! the program of the controller reports a fault to the line when its connection to this service ends.

use super::background::lower_priority;
use super::gateway::Gateway;
use super::people::AccountService;
use super::ports::LastState;
use super::request::{Reply, RequestKind, RequestResult};
use crate::setup::{RecipeText, RecipeTextPermission, StartRequest};
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::cell::{InputsOutputs, LINE_INPUTS, Line};
use panelprep_cell::cycle;
use panelprep_cell::line::{CellStatus, Handshake, LineInputs, LineObservation, LineRequest};
use panelprep_cell::record::PartNames;
use panelprep_cell::record::{RequestAuthor, RequestSource, RequestedAction};
use panelprep_devices::robot::LineOutputs;
use std::sync::Arc;
use std::thread;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::oneshot;
use tokio::time::{MissedTickBehavior, interval};

/// Interval at which the thread reads the inputs and sets the outputs; the controller reports its inputs at this
/// interval.
const UPDATE_INTERVAL: Duration = Duration::from_millis(100);
/// Number of threads that read the recipe and wait for the store's disk.
const BLOCKING_THREADS: usize = 2;
/// Maximum time for which the program's shutdown waits for these threads.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(1);

/// The parts of the service that the handshake needs.
pub struct LineParts {
    /// The `[line]` table of the cell's file.
    pub line: Line,
    /// Bit numbers of `part_present` and `start_request` among the controller's inputs.
    pub inputs: [u32; 2],
    /// The last reported state of the robot.
    pub last: LastState,
    /// The controller's outputs for the production line.
    pub outputs: LineOutputs,
    /// The entry point for requests.
    pub gateway: Gateway,
    /// The audit trail.
    pub people: Arc<AccountService>,
}

impl LineParts {
    /// Returns the bit numbers of the line's inputs, if the cell names both inputs.
    pub fn input_bits(io: &InputsOutputs) -> Option<[u32; 2]> {
        let [part_present, start_request] = LINE_INPUTS.map(|name| io.input_bit(name));
        Some([part_present?, start_request?])
    }
}

/// The running handshake; dropping this value ends it.
#[derive(Debug)]
pub struct LineFront {
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl LineFront {
    /// Starts the handshake.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn serve(parts: LineParts) -> std::io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_time().max_blocking_threads(BLOCKING_THREADS).build()?;
        let (end, mut ended) = oneshot::channel();
        let serve = move || {
            lower_priority();
            runtime.block_on(async {
                tokio::select! {
                    () = run_handshake(parts) => {}
                    _ = &mut ended => {}
                }
            });
            runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
        };
        let thread = thread::Builder::new().name("line".to_owned()).spawn(serve)?;
        Ok(LineFront { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for LineFront {
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

async fn run_handshake(parts: LineParts) {
    let mut handshake = Handshake::default();
    let mut tick = interval(UPDATE_INTERVAL);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut last_reported = None;
    // A signal cannot name a recipe; therefore the recipe with which the service was started is used.
    let recipe = parts.recipe().await;
    loop {
        tick.tick().await;
        let look = parts.read_observation().await;
        let request = handshake.evaluate(look.clone());
        let now = handshake.output_signals(&look);
        if last_reported.replace(now) != Some(now) {
            parts.outputs.set(now.0);
        }
        if let Some(request) = request
            && !parts.send_request(request, &recipe).await
        {
            handshake.refused(request);
        }
    }
}

impl LineParts {
    async fn read_observation(&self) -> LineObservation {
        let reply = self.gateway.request(RequestKind::State, RequestAuthor::from_source(RequestSource::Line)).await;
        let inputs = self.last.inputs().map(|bits| {
            let [part_present, start_request] = self.inputs.map(|bit| bits >> bit & 1 == 1);
            LineInputs { part_present, start_request }
        });
        let cell = reply.state.map(|state| CellStatus {
            state,
            is_review: reply.extras.is_review,
            verdict: reply.verdict,
        });
        LineObservation { inputs, cell }
    }

    /// Sends the request to the cell; returns whether the request was accepted. The loop records the request and its
    /// result.
    async fn send_request(&self, request: LineRequest, recipe: &Result<RecipeText, String>) -> bool {
        let (word, asked) = match request {
            LineRequest::Start => ("start", self.start(recipe).await),
            LineRequest::Reset => ("reset", Ok(RequestKind::Table(cycle::Request::Reset))),
        };
        let who = RequestAuthor::from_source(RequestSource::Line);
        let reply = match asked {
            Ok(what) => self.gateway.request(what, who).await,
            Err(problem) => {
                let reasons = vec![Reason::new("bad_input", problem)];
                let wanted = RequestedAction::Start { recipe: self.line.recipe.display().to_string() };
                self.gateway.keep_refused(wanted, who, reasons.clone());
                Reply::refused(RequestResult::Refused, reasons)
            }
        };
        if reply.answer == RequestResult::Done {
            return true;
        }
        tracing::warn!("the production line requested a {word}, which was refused: {}", reply.joined_reasons());
        if reply.may_be_unrecorded() {
            self.write_audit(word, reply.joined_reasons()).await;
        }
        false
    }

    /// Adds an entry to the audit trail for a request that was refused before the loop received it.
    async fn write_audit(&self, word: &str, refused: String) {
        let from = "the handshake with the production line".to_owned();
        let entry =
            AuditEntry { refused: Some(refused), ..AuditEntry::for_completed_action(None, None, from, word) };
        let people = self.people.clone();
        #[expect(
            clippy::let_underscore_must_use,
            reason = "an entry that cannot be stored is written to the service's log"
        )]
        let _ = tokio::task::spawn_blocking(move || people.audit(&entry)).await;
    }

    /// Returns the request to start a cycle with the recipe and the part that the cell's file names. A recipe that was
    /// changed after the service started is refused.
    async fn start(&self, recipe: &Result<RecipeText, String>) -> Result<RequestKind, String> {
        let wanted = recipe.as_ref().map_err(|problem| add_restart_advice(problem))?;
        let now = self.recipe().await?;
        let recipe = now.if_unchanged(&wanted.sha256()).map_err(|problem| add_restart_advice(&problem))?;
        Ok(RequestKind::Start(start_request(&self.line, recipe)))
    }

    /// Reads the present text of the recipe that the cell's file names.
    async fn recipe(&self) -> Result<RecipeText, String> {
        let file = self.line.recipe.clone();
        let read = tokio::task::spawn_blocking(move || RecipeText::read(&file)).await;
        read.map_err(|error| error.to_string())?.map_err(|fault| fault.to_string())
    }
}

fn start_request(line: &Line, RecipeText { name, text }: RecipeText) -> StartRequest {
    let Line { serial, order, operator, .. } = line.clone();
    StartRequest {
        recipe: name,
        text,
        record: None,
        part: Some(PartNames { serial, order, operator }),
        another_part: false,
        lost_passes: None,
        is_stated_clear: false,
        own_text: RecipeTextPermission::Allowed,
    }
}

/// Adds to a problem that the service must be restarted to use the present recipe.
fn add_restart_advice(problem: &str) -> String {
    format!("{problem}; restart the service if the line is to use the current recipe")
}

#[cfg(test)]
mod tests {
    //! Tests the handshake over the connection to the robot, with a controller that executes its own programs: the
    //! line's inputs and outputs are those of the controller.

    use super::{LineFront, LineParts, RecipeText, start_request};
    use crate::daemon::gateway::Gateway;
    use crate::daemon::people::AccountService;
    use crate::daemon::ports::LastState;
    use crate::daemon::request::{Reply, RequestKind, RequestResult};
    use crate::daemon::request_queue::{RequestQueue, request_queue};
    use panelprep_base::verdict::{Reason, Verdict};
    use panelprep_cell::cell::{Line, LineSignal};
    use panelprep_cell::cycle;
    use panelprep_cell::line::LineSignals;
    use panelprep_cell::record::RequestedAction;
    use panelprep_devices::mock;
    use panelprep_devices::mock::{MockServer, Programs};
    use panelprep_devices::robot::{Address, BlockingLink};
    use panelprep_kuka::eki::{CELLCMD, CELLSTAT, ClockMode, LinkLimits, Report};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, Mutex, mpsc};
    use std::thread::JoinHandle;
    use std::time::{Duration, Instant};

    /// Time limit of the test, long enough for a busy machine.
    const TIMEOUT: Duration = Duration::from_secs(60);
    /// Numbers of the inputs part present and start request, and below them of the six outputs.
    const INPUTS: [u16; 2] = [30, 31];
    const OUTPUTS: [u16; 6] = [40, 41, 42, 43, 44, 45];

    /// Test bench: a controller, the connection to it, and a loop that only answers requests.
    struct Bench {
        server: MockServer,
        /// The state and verdict that the loop reports.
        state: Arc<Mutex<(&'static str, Option<Verdict>)>>,
        /// The recipes of the starts that were refused, since there is no cell.
        starts: mpsc::Receiver<String>,
        resets: mpsc::Receiver<()>,
        front: Option<LineFront>,
        is_over: Arc<AtomicBool>,
        link: Option<JoinHandle<()>>,
        _folder: tempfile::TempDir,
    }

    impl Drop for Bench {
        fn drop(&mut self) {
            drop(self.front.take());
            self.is_over.store(true, Ordering::Relaxed);
        }
    }

    impl Bench {
        fn new() -> Self {
            let [commands, states] =
                [CELLCMD, CELLSTAT].map(|text| mock::ChannelFile::parse(text).expect("shipped"));
            let setup = mock::Setup {
                clock: mock::Clock::Free,
                inputs: vec![17, INPUTS[0], INPUTS[1]],
                line_outputs: OUTPUTS,
                programs: Some(Programs::shipped().expect("right")),
                ..mock::Setup::new(commands, states)
            };
            let controller = mock::Controller::new(setup, Box::new(mock::UnconnectedWorld)).expect("fits");
            let server = MockServer::start(controller, mock::Ports::free_ports()).expect("starts");
            let address = Address {
                host: "127.0.0.1".to_owned(),
                command_port: server.command_address().port(),
                state_port: server.state_address().port(),
            };
            let link = BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts");
            let (last, outputs) = (LastState::default(), link.line());
            let is_over = Arc::new(AtomicBool::new(false));
            let link = std::thread::spawn({
                let (last, is_over) = (last.clone(), is_over.clone());
                move || receive_reports(link, &last, &is_over)
            });
            let folder = tempfile::tempdir().expect("a folder");
            let recipe = folder.path().join("door.toml");
            std::fs::write(&recipe, "panel = \"door\"\n").expect("written");
            let (sender, queue) = request_queue();
            let (tell_start, starts) = mpsc::channel();
            let gateway = Gateway::without_cell(sender, Reason::new("bad_input", "not here"));
            let state = Arc::new(Mutex::new(("idle", None)));
            let (tell_reset, resets) = mpsc::channel();
            let (reported, over) = (state.clone(), is_over.clone());
            std::thread::spawn(move || answer((&queue, &over), &reported, (&tell_start, &tell_reset)));
            let line = Line { recipe, serial: None, order: Some("WO 7".to_owned()), operator: None };
            let people = Arc::new(AccountService::new(folder.path().to_owned()));
            let parts = LineParts { line, inputs: [1, 2], last, outputs, gateway, people };
            let front = Some(LineFront::serve(parts).expect("a thread"));
            Bench { server, state, starts, resets, front, is_over, link: Some(link), _folder: folder }
        }

        fn line_sets(&self, part_present: bool, start_request: bool) {
            self.server.handle().with_controller(|controller| {
                controller.set_input(INPUTS[0], part_present);
                controller.set_input(INPUTS[1], start_request);
            });
        }

        fn cell_is(&self, state: &'static str, verdict: Option<Verdict>) {
            *self.state.lock().expect("whole") = (state, verdict);
        }

        /// Waits until exactly these signals of the line are on.
        fn line_reads(&self, signals: &[LineSignal]) {
            let (wanted, since) = (LineSignals::from_signals(signals), Instant::now());
            loop {
                let outputs = self.server.handle().with_controller(|controller| controller.outputs().clone());
                let on = |number: &u16| outputs.get(number) == Some(&true);
                let read =
                    OUTPUTS.iter().enumerate().filter(|(_, number)| on(number)).map(|(place, _)| 1 << place).sum();
                if LineSignals(read) == wanted {
                    return;
                }
                assert!(since.elapsed() < TIMEOUT, "{signals:?}: found {read:06b}");
                std::thread::sleep(Duration::from_millis(20));
            }
        }
    }

    /// Reads reports and stores the last state, as the loop does.
    fn receive_reports(mut link: BlockingLink, last: &LastState, is_over: &AtomicBool) {
        while !is_over.load(Ordering::Relaxed) {
            match link.next(Duration::from_millis(20)) {
                Some(Report::State(state) | Report::Connected { state }) => last.set(Some(&state)),
                Some(Report::LinkLost { .. }) => last.set(None),
                _ => {}
            }
        }
    }

    /// Answers requests as the loop does: reports the state, and changes to idle after a reset.
    fn answer(
        (queue, is_over): (&RequestQueue, &AtomicBool),
        state: &Mutex<(&'static str, Option<Verdict>)>,
        (starts, resets): (&mpsc::Sender<String>, &mpsc::Sender<()>),
    ) {
        while !is_over.load(Ordering::Relaxed) {
            let Some(request) = queue.next(Duration::from_millis(50)) else { continue };
            match request.what {
                RequestKind::Table(cycle::Request::Reset) => {
                    *state.lock().expect("whole") = ("idle", None);
                    let _ = resets.send(());
                }
                RequestKind::Refused { wanted: RequestedAction::Start { recipe }, .. } => {
                    let _ = starts.send(recipe);
                }
                _ => {}
            }
            let (word, verdict) = *state.lock().expect("whole");
            let reply =
                Reply { state: Some(word.to_owned()), verdict, ..Reply::refused(RequestResult::Done, vec![]) };
            if let Some(waits) = request.reply {
                let _ = waits.send(reply);
            }
        }
    }

    #[test]
    fn a_start_of_the_line_has_the_recipe_and_the_names_of_the_cells_file() {
        let line = Line {
            recipe: "door.toml".into(),
            serial: None,
            order: Some("WO 7".to_owned()),
            operator: Some("Ada".to_owned()),
        };
        let recipe = RecipeText { name: "door.toml".to_owned(), text: "panel = \"door\"\n".to_owned() };
        let start = start_request(&line, recipe);
        assert_eq!((start.recipe.as_str(), start.text.as_str()), ("door.toml", "panel = \"door\"\n"));
        let part = start.part.expect("named");
        assert_eq!((part.order.as_deref(), part.operator.as_deref()), (Some("WO 7"), Some("Ada")));
    }

    /// Tests three sequences: a start by a signal edge with the recipe and work order of the cell's file, which is
    /// refused and reported; a completed cycle, whose part is then removed, and a reset; and a fault when no thread
    /// serves the link.
    #[test]
    fn a_production_line_controls_the_cell_by_signals() {
        use LineSignal::{CycleDone, Fail, Fault, Pass, Ready};
        let mut bench = Bench::new();
        bench.line_sets(true, true);
        bench.line_reads(&[Ready]);
        std::thread::sleep(Duration::from_millis(500));
        assert!(bench.starts.try_recv().is_err(), "the request was high from the start");

        bench.line_sets(true, false);
        std::thread::sleep(Duration::from_millis(500));
        bench.line_sets(true, true);
        let recipe = bench.starts.recv_timeout(TIMEOUT).expect("an edge asks");
        assert!(recipe.ends_with("door.toml"), "{recipe}");
        bench.line_reads(&[Fault]);
        bench.line_sets(true, false);
        bench.line_reads(&[Ready]);
        assert!(bench.starts.try_recv().is_err(), "one edge asks once");

        bench.cell_is("execute", None);
        bench.line_reads(&[]);
        bench.cell_is("complete", Some(Verdict::Fail));
        bench.line_reads(&[CycleDone, Fail]);
        bench.cell_is("complete", Some(Verdict::Pass));
        bench.line_reads(&[CycleDone, Pass]);
        std::thread::sleep(Duration::from_millis(500));
        assert!(bench.resets.try_recv().is_err(), "the part is still there");
        bench.line_sets(false, false);
        bench.resets.recv_timeout(TIMEOUT).expect("the part is gone");
        bench.line_reads(&[Ready]);

        // The service ends; the controller's own program reports this to the line.
        drop(bench.front.take());
        bench.is_over.store(true, Ordering::Relaxed);
        bench.link.take().expect("it runs").join().expect("it ends");
        bench.line_reads(&[Fault]);
    }
}
