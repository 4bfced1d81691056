//! Keeps a worker: starts it, opens the camera, warms it up, watches it, asks it, and starts it again while its budget lasts.
//!
//! ```text
//! start ─ hello ─ connect ─ settings ─ warm-up ─ ready ─┬─ asked … ─┐
//!   ↑                ↑________________ camera gone ______│           │
//!   └─── restart, within the budget ──── worker lost ────┴───────────┘
//! ```
//! It has a thread of its own and answers through a channel, so that nobody who asks waits longer than they said. A
//! worker is lost where it ends, stalls, or says what cannot be read; then it is killed, since nothing it sends later
//! could be believed. A camera that is absent is looked for again and again by the same worker, told once. Each
//! fault is kept in words: none is mended in silence.

use super::accept::{self, Asked};
use super::budget::{Budget, Restarts, Verdict};
use super::clock::now_ns;
use super::fault::{Next, ZividFault};
use super::link::{Answer, Came, Link};
use super::message::{
    ClipEnd, Identity, Lens, Refusal, Reply, Request, SettingsHash, Size, Source, Temperatures, Trouble, Use,
};
use super::process::{Launcher, Peer};
use super::sensor::Planes;
use super::wire::WireError;
use super::worker::settings_hash;
use std::collections::VecDeque;
use std::io::ErrorKind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What a camera is set up with.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Which camera.
    pub source: Source,
    /// The serial number that its calibration is of, where that is known.
    pub serial: Option<String>,
    /// The size of its calibration.
    pub size: Size,
    /// Settings of 3D shots: the text of their YAML file.
    pub scan_yaml: String,
    /// Settings of pictures.
    pub picture_yaml: String,
    /// How often the worker is started again.
    pub restarts: Restarts,
    /// How long is waited for what.
    pub patience: Patience,
}

/// How long is waited for what.
#[derive(Debug, Clone, Copy)]
pub struct Patience {
    /// The worker's first words: the SDK starts.
    pub hello: Duration,
    /// A camera is searched and opened; the vendor's own samples give it 100 s.
    pub connect: Duration,
    /// The first shot, for which the SDK may compile its programs: 100 s in the vendor's samples.
    pub warm_up: Duration,
    /// A 3D shot.
    pub scan: Duration,
    /// A picture, or the next of a clip.
    pub picture: Duration,
    /// Words: settings, temperatures.
    pub words: Duration,
    /// From one search for an absent camera to the next.
    pub search: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        let s = Duration::from_secs;
        Patience {
            hello: s(30),
            connect: s(100),
            warm_up: s(100),
            scan: s(15),
            picture: s(6),
            words: s(10),
            search: s(3),
        }
    }
}

impl Patience {
    /// From nothing to the first shot.
    pub fn start(&self) -> Duration {
        self.hello + self.connect + 2 * self.words + self.warm_up
    }
}

/// How the camera stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Stage {
    /// The worker is being started, since then.
    Starting(Instant),
    /// It delivers.
    Ready(Identity),
    /// The worker is there, the camera is not, or not as it should be.
    NoCamera(ZividFault),
    /// The worker stays down until a person asks for it.
    Down(ZividFault),
}

/// What is known of the camera, for all who ask.
#[derive(Debug)]
pub struct Status {
    /// How it stands.
    pub stage: Stage,
    /// How often a worker was lost.
    pub lost: usize,
    /// The last faults, in order.
    pub faults: VecDeque<ZividFault>,
    /// The worker's process.
    pub worker: Option<u32>,
}

/// Faults that are kept.
const MOST_FAULTS: usize = 1_000;

/// What the thread and its users share.
#[derive(Debug)]
pub struct Shared {
    status: Mutex<Status>,
    news: Condvar,
    /// Nobody asks any more.
    pub is_ending: Arc<AtomicBool>,
}

impl Default for Shared {
    /// Before the first start.
    fn default() -> Self {
        let stage = Stage::Starting(Instant::now());
        let status = Status { stage, lost: 0, faults: VecDeque::new(), worker: None };
        Shared { status: Mutex::new(status), news: Condvar::new(), is_ending: Arc::default() }
    }
}

impl Shared {
    /// The status as it is.
    pub fn status(&self) -> MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the camera is not being started any more, at most so long; gives how it stands then.
    pub fn settled(&self, within: Duration) -> Stage {
        let starting = |status: &mut Status| matches!(status.stage, Stage::Starting(_));
        let waited = self.news.wait_timeout_while(self.status(), within, starting);
        waited.unwrap_or_else(PoisonError::into_inner).0.stage.clone()
    }

    fn becomes(&self, stage: Stage) {
        self.status().stage = stage;
        self.news.notify_all();
    }

    fn note(&self, fault: &ZividFault) {
        let mut status = self.status();
        status.faults.push_back(fault.clone());
        if status.faults.len() > MOST_FAULTS {
            status.faults.pop_front();
        }
        tracing::warn!("{fault}");
    }
}

/// What is asked of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ask {
    /// A 3D shot.
    Scan,
    /// A picture.
    Picture,
    /// Pictures from now on, at most so many a second.
    BeginClip(f64),
    /// The next one.
    NextPicture,
    /// No more.
    EndClip,
    /// The camera's model of its lens, for 3D shots.
    Intrinsics,
    /// Its temperatures; a worker that stays down is started again where its budget allows.
    Check,
}

impl Ask {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Ask::Scan => "a 3D shot",
            Ask::Picture => "a picture",
            Ask::BeginClip(_) => "the begin of a clip",
            Ask::NextPicture => "a picture of a clip",
            Ask::EndClip => "the end of a clip",
            Ask::Intrinsics => "a look at its lens",
            Ask::Check => "a look at its temperatures",
        }
    }
}

/// What came of it.
#[derive(Debug)]
pub enum Found {
    /// A 3D shot.
    Scan(Came, Planes),
    /// A picture.
    Picture(Came, Vec<[u8; 3]>),
    /// Done.
    Done,
    /// A clip is over.
    Clip(ClipEnd),
    /// The lens.
    Lens(Lens),
    /// The temperatures.
    State(Temperatures),
}

/// A question, and where its answer goes.
#[derive(Debug)]
pub struct Order {
    /// What is asked.
    pub ask: Ask,
    /// Who asked has gone.
    pub is_given_up: Arc<AtomicBool>,
    /// Where the answer goes.
    pub answer: Sender<Result<Found, ZividFault>>,
}

/// How often a shot that the camera did not give is asked for again: once and two more.
const TRIES: u32 = 3;
/// How often an idle worker is looked after.
const LOOK: Duration = Duration::from_millis(50);
/// How long a worker that hung up, or is let go, may take to end by itself.
const FAREWELL: Duration = Duration::from_millis(500);

struct Worker {
    link: Link,
    peer: Box<dyn Peer>,
}

/// The settings' names and what was last taken with each.
struct Taking {
    hash: SettingsHash,
    last_sum: Option<u32>,
}

/// The thread's own.
pub struct Host {
    setup: Setup,
    launch: Launcher,
    shared: Arc<Shared>,
    budget: Budget,
    began: Instant,
    worker: Option<Worker>,
    camera: Option<Identity>,
    scan: Taking,
    picture: Taking,
    last_number: u64,
    clip_from_ns: u64,
    /// When an absent camera is looked for again.
    search: Instant,
}

/// Why the worker did not do what was asked.
enum Failed {
    /// It is lost.
    Lost(WireError),
    /// It says why.
    Refused(Refusal),
}

impl From<WireError> for Failed {
    fn from(error: WireError) -> Self {
        Failed::Lost(error)
    }
}

impl Host {
    /// Before the first start.
    pub fn new(setup: Setup, launch: Launcher, shared: Arc<Shared>) -> Self {
        let taking = |yaml: &str| Taking { hash: settings_hash(yaml), last_sum: None };
        let now = Instant::now();
        Host {
            scan: taking(&setup.scan_yaml),
            picture: taking(&setup.picture_yaml),
            budget: Budget::new(setup.restarts),
            setup,
            launch,
            shared,
            began: now,
            worker: None,
            camera: None,
            last_number: 0,
            clip_from_ns: 0,
            search: now,
        }
    }

    /// Serves until nobody asks any more.
    pub fn run(mut self, orders: &Receiver<Order>) {
        loop {
            self.look_after();
            match orders.recv_timeout(LOOK) {
                Ok(order) if order.is_given_up.load(Ordering::Relaxed) => {}
                // Who asked may have gone meanwhile.
                Ok(order) => drop(order.answer.send(self.perform(order.ask))),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.farewell(),
            }
            if self.shared.is_ending.load(Ordering::Relaxed) {
                return self.farewell();
            }
        }
    }

    fn farewell(&mut self) {
        if let Some(Worker { link, mut peer }) = self.worker.take() {
            drop(link); // hangs up
            let _ = peer.ended(FAREWELL);
        }
    }

    /// Brings the camera on, as far as it goes.
    fn look_after(&mut self) {
        if matches!(self.shared.status().stage, Stage::Down(_)) {
            return;
        }
        if let Some(how) = self.worker.as_mut().and_then(|worker| worker.peer.ended(Duration::ZERO)) {
            self.lost("its rest", Loss::Ended(how));
        } else if self.worker.is_none() {
            self.start();
        } else if self.camera.is_none() && Instant::now() >= self.search {
            self.open();
        }
    }

    /// Starts a worker and opens the camera.
    fn start(&mut self) {
        self.shared.becomes(Stage::Starting(Instant::now()));
        let (stream, peer) = match (self.launch)() {
            Ok(started) => started,
            Err(error) => return self.down(ZividFault::NoWorker(format!("it cannot be started: {error}"))),
        };
        self.shared.status().worker = peer.id();
        let mut link = Link::new(stream, self.shared.is_ending.clone());
        let hello = link.hello(self.setup.patience.hello);
        self.worker = Some(Worker { link, peer });
        let during = "its start";
        match hello {
            Err(WireError::Version { found }) => {
                let expected = super::wire::VERSION.to_string();
                self.down(ZividFault::WrongVersion { found: format!("protocol {found}"), expected });
            }
            Err(error) => drop(self.lost(during, Loss::of(error, self.setup.patience.hello))),
            Ok(hello) if hello.program != env!("CARGO_PKG_VERSION") => {
                let expected = env!("CARGO_PKG_VERSION").to_owned();
                self.down(ZividFault::WrongVersion { found: hello.program, expected });
            }
            Ok(hello) => match hello.sdk {
                Err(why) => self.down(ZividFault::NoWorker(why)),
                Ok(sdk) => {
                    tracing::info!("the 3D camera's worker runs; Zivid SDK: {sdk}");
                    self.open();
                }
            },
        }
    }

    /// Opens the camera; what keeps it from that is told once.
    fn open(&mut self) {
        match self.opened() {
            Ok(identity) => {
                tracing::info!("the 3D camera is ready: {} {}", identity.model, identity.serial);
                self.camera = Some(identity.clone());
                self.shared.becomes(Stage::Ready(identity));
            }
            Err(Opening::Lost(during, loss)) => drop(self.lost(during, loss)),
            Err(Opening::NoCamera(fault)) => {
                self.search = Instant::now() + self.setup.patience.search;
                self.without_camera(fault);
            }
        }
    }

    fn opened(&mut self) -> Result<Identity, Opening> {
        let (setup, patience) = (self.setup.clone(), self.setup.patience);
        let connect = Request::Connect { source: setup.source.clone() };
        let refused = |refusal: Refusal| Opening::NoCamera(ZividFault::NotFound(refusal.message));
        let identity = match self.step(&connect, ("its opening", patience.connect), refused)? {
            Answer::Words(Reply::Connected(identity)) => identity,
            other => return Err(foreign("its opening", &other)),
        };
        let by_source = match &setup.source {
            Source::Serial(serial) => Some(serial),
            _ => None,
        };
        if let Some(expected) = setup.serial.iter().chain(by_source).find(|serial| **serial != identity.serial) {
            let (found, expected) = (identity.serial, expected.clone());
            return Err(Opening::NoCamera(ZividFault::WrongCamera { found, expected }));
        }
        let uses = [
            (Use::Scan, "the settings for 3D shots", setup.scan_yaml, self.scan.hash.clone()),
            (Use::Picture, "the settings for pictures", setup.picture_yaml, self.picture.hash.clone()),
        ];
        for (usage, what, yaml, hash) in uses {
            let refused =
                |refusal: Refusal| Opening::NoCamera(ZividFault::Settings { what, message: refusal.message });
            let request = Request::Settings { usage, yaml, hash };
            match self.step(&request, ("its settings", patience.words), refused)? {
                Answer::Words(Reply::Settings(size)) if size == setup.size => {}
                Answer::Words(Reply::Settings(size)) => {
                    let px = |size: Size| [size.width, size.height];
                    let (found_px, expected_px) = (px(size), px(setup.size));
                    return Err(Opening::NoCamera(ZividFault::WrongSize { what, found_px, expected_px }));
                }
                other => return Err(foreign("its settings", &other)),
            }
        }
        // What it shows does not matter; that the SDK is warm does.
        let request = Request::Scan { settings: self.scan.hash.clone() };
        let during = "its first shot";
        let refused = |refusal: Refusal| {
            let message = refusal.message;
            Opening::NoCamera(ZividFault::NoShot { during, tries: 1, message })
        };
        match self.step(&request, (during, patience.warm_up), refused)? {
            Answer::Scan(came, _) => {
                self.last_number = came.taken.number;
                Ok(identity)
            }
            other => Err(foreign(during, &other)),
        }
    }

    /// One step of the opening.
    fn step(
        &mut self,
        request: &Request,
        (during, within): (&'static str, Duration),
        refused: impl FnOnce(Refusal) -> Opening,
    ) -> Result<Answer, Opening> {
        self.ask(request, within).map_err(|failed| match failed {
            Failed::Lost(error) => Opening::Lost(during, Loss::of(error, within)),
            Failed::Refused(refusal) => refused(refusal),
        })
    }

    fn ask(&mut self, request: &Request, within: Duration) -> Result<Answer, Failed> {
        let worker = self.worker.as_mut().ok_or(WireError::Ended)?;
        match worker.link.ask(request, within)? {
            Answer::Words(Reply::Refused(refusal)) => Err(Failed::Refused(refusal)),
            answer => Ok(answer),
        }
    }

    /// The worker is there and the camera is not as it should be.
    fn without_camera(&mut self, fault: ZividFault) {
        self.camera = None;
        let is_known = matches!(&self.shared.status().stage, Stage::NoCamera(known) if *known == fault);
        if !is_known {
            self.shared.note(&fault);
            self.shared.becomes(Stage::NoCamera(fault));
        }
    }

    /// The worker is lost: it is ended, and started again where the budget allows.
    fn lost(&mut self, during: &'static str, loss: Loss) -> ZividFault {
        if self.shared.is_ending.load(Ordering::Relaxed) {
            // Nobody asks any more, and nobody is told.
            self.end_worker();
            return ZividFault::Ended { how: "the program ends".to_owned(), during, next: Next::StaysDown };
        }
        let verdict = self.budget.ended(self.began.elapsed());
        let allowed = self.budget.allowed();
        let next = match verdict {
            Verdict::Restart { number } => Next::Restart { number, of: allowed.most, within: allowed.within },
            Verdict::StayDown => Next::StaysDown,
        };
        let fault = match (loss, self.end_worker()) {
            (Loss::Ended(how), _) => ZividFault::Ended { how, during, next },
            (Loss::HungUp, how) => {
                let how = how.unwrap_or_else(|| "it hung up".to_owned());
                ZividFault::Ended { how, during, next }
            }
            (Loss::Stalled(waited), _) => ZividFault::Timeout { during, waited, next },
            (Loss::Damaged(cause), _) => ZividFault::Damaged { during, cause, next },
        };
        self.shared.status().lost += 1;
        self.shared.note(&fault);
        match verdict {
            Verdict::Restart { .. } => self.shared.becomes(Stage::Starting(Instant::now())),
            Verdict::StayDown => {
                let down = self.stays_down(&fault);
                self.down(down);
            }
        }
        fault
    }

    fn stays_down(&self, last: &ZividFault) -> ZividFault {
        let Restarts { most, within } = self.budget.allowed();
        let wait = self.budget.wait(self.began.elapsed());
        ZividFault::Down { ended: most + 1, allowed: most, within, last: last.to_string(), wait }
    }

    /// No worker, and none is started before a person asks.
    fn down(&mut self, fault: ZividFault) {
        self.end_worker();
        self.shared.note(&fault);
        self.shared.becomes(Stage::Down(fault));
    }

    /// Ends the worker; how it ended, where it did so by itself.
    fn end_worker(&mut self) -> Option<String> {
        self.camera = None;
        // A shot of another worker is no repetition of its own.
        (self.last_number, self.scan.last_sum, self.picture.last_sum) = (0, None, None);
        let Worker { link, mut peer } = self.worker.take()?;
        drop(link);
        let how = peer.ended(FAREWELL);
        peer.kill();
        self.shared.status().worker = None;
        how
    }

    fn perform(&mut self, ask: Ask) -> Result<Found, ZividFault> {
        let stage = self.shared.status().stage.clone();
        match (stage, ask) {
            (Stage::Ready(_), _) => self.asked(ask),
            (Stage::Starting(since), _) => {
                Err(ZividFault::Starting { since: since.elapsed(), most: self.setup.patience.start() })
            }
            (Stage::NoCamera(fault), _) => Err(fault),
            (Stage::Down(fault), Ask::Check) => self.revived(fault),
            (Stage::Down(fault), _) => Err(self.as_of_now(fault)),
        }
    }

    /// The same with the time that is left.
    fn as_of_now(&self, fault: ZividFault) -> ZividFault {
        match fault {
            ZividFault::Down { ended, allowed, within, last, .. } => {
                let wait = self.budget.wait(self.began.elapsed());
                ZividFault::Down { ended, allowed, within, last, wait }
            }
            other => other,
        }
    }

    /// A person asks for a worker that stays down.
    fn revived(&mut self, fault: ZividFault) -> Result<Found, ZividFault> {
        // What is not for the budget, such as a missing library, may be mended at any time.
        let by_budget = matches!(fault, ZividFault::Down { .. });
        if by_budget && self.budget.asked(self.began.elapsed()) == Verdict::StayDown {
            return Err(self.as_of_now(fault));
        }
        self.start();
        let stage = self.shared.status().stage.clone();
        match stage {
            Stage::Ready(_) => self.asked(Ask::Check),
            Stage::Starting(since) => {
                Err(ZividFault::Starting { since: since.elapsed(), most: self.setup.patience.start() })
            }
            Stage::NoCamera(fault) | Stage::Down(fault) => Err(fault),
        }
    }

    /// Asks a camera that is ready.
    fn asked(&mut self, ask: Ask) -> Result<Found, ZividFault> {
        let (scan, picture) = (self.scan.hash.clone(), self.picture.hash.clone());
        let patience = self.setup.patience;
        let (request, within) = match ask {
            Ask::Scan => (Request::Scan { settings: scan }, patience.scan),
            Ask::Picture => (Request::Picture { settings: picture }, patience.picture),
            Ask::BeginClip(pictures_per_second) => {
                self.clip_from_ns = now_ns();
                (Request::BeginClip { settings: picture, pictures_per_second }, patience.picture)
            }
            Ask::NextPicture => (Request::NextPicture, patience.picture),
            // The picture that is being taken is waited for.
            Ask::EndClip => (Request::EndClip, patience.picture),
            Ask::Intrinsics => (Request::Intrinsics { settings: scan }, patience.words),
            Ask::Check => (Request::State, patience.words),
        };
        let during = ask.words();
        let mut tries = 0;
        loop {
            tries += 1;
            let from_ns = if ask == Ask::NextPicture { self.clip_from_ns } else { now_ns() };
            let message = match self.ask(&request, within) {
                Ok(answer) => match self.checked(ask, from_ns, answer) {
                    // The camera's own buffer may have given the shot before once more.
                    Err(ZividFault::Frozen(_)) if tries < 2 => continue,
                    other => return other.inspect_err(|fault| self.shared.note(fault)),
                },
                Err(Failed::Lost(error)) => return Err(self.lost(during, Loss::of(error, within))),
                Err(Failed::Refused(refusal)) => {
                    if let Some(fault) = self.refused(ask, &refusal) {
                        return Err(fault);
                    }
                    refusal.message
                }
            };
            if tries >= TRIES {
                let fault = ZividFault::NoShot { during, tries, message };
                self.shared.note(&fault);
                return Err(fault);
            }
        }
    }

    /// What a refusal means; none where asking again may help.
    fn refused(&mut self, ask: Ask, refusal: &Refusal) -> Option<ZividFault> {
        let (during, message) = (ask.words(), refusal.message.clone());
        let is_shot = matches!(ask, Ask::Scan | Ask::Picture);
        match refusal.trouble {
            Trouble::Gone | Trouble::NotFound => {
                let fault = ZividFault::Lost { during, message };
                self.search = Instant::now();
                self.without_camera(fault.clone());
                Some(fault)
            }
            Trouble::NoShot if is_shot => None,
            Trouble::NoShot => Some(ZividFault::NoShot { during, tries: 1, message }),
            Trouble::Settings | Trouble::OutOfOrder => Some(ZividFault::OutOfOrder { during, message }),
        }
        .inspect(|fault| {
            if !matches!(fault, ZividFault::Lost { .. }) {
                self.shared.note(fault);
            }
        })
    }

    /// Holds an answer against what was asked.
    fn checked(&mut self, ask: Ask, from_ns: u64, answer: Answer) -> Result<Found, ZividFault> {
        match (ask, answer) {
            (Ask::Scan, Answer::Scan(came, planes)) => {
                self.accepted(ask, from_ns, &came)?;
                accept::accept_points(&planes)?;
                if came.taken.throttled_ms > 0.0 {
                    tracing::warn!("the 3D camera paused for {:.0} ms to cool", came.taken.throttled_ms);
                }
                Ok(Found::Scan(came, planes))
            }
            (Ask::Picture | Ask::NextPicture, Answer::Picture(came, rgb)) => {
                self.accepted(ask, from_ns, &came)?;
                accept::accept_pause(&came.taken, ask.words())?;
                Ok(Found::Picture(came, rgb))
            }
            (Ask::BeginClip(_), Answer::Words(Reply::ClipBegun)) => Ok(Found::Done),
            (Ask::EndClip, Answer::Words(Reply::ClipEnded(end))) => Ok(Found::Clip(end)),
            (Ask::Intrinsics, Answer::Words(Reply::Intrinsics(lens))) => Ok(Found::Lens(lens)),
            (Ask::Check, Answer::Words(Reply::State(temperatures))) => Ok(Found::State(temperatures)),
            (_, other) => Err(self.lost(ask.words(), Loss::Damaged(name(&other)))),
        }
    }

    fn accepted(&mut self, ask: Ask, from_ns: u64, came: &Came) -> Result<(), ZividFault> {
        let is_file = matches!(self.setup.source, Source::File(_));
        let (size, last_number) = (self.setup.size, self.last_number);
        let serial = self.camera.as_ref().map(|camera| camera.serial.clone()).unwrap_or_default();
        let taking = if ask == Ask::Scan { &mut self.scan } else { &mut self.picture };
        let last_sum = taking.last_sum.filter(|_| !is_file);
        let settings = taking.hash.clone();
        let until_ns = came.came_ns;
        let asked = Asked { what: ask.words(), settings, serial, size, from_ns, until_ns, last_number, last_sum };
        accept::accept(&came.taken, came.sum, &asked)?;
        taking.last_sum = Some(came.sum);
        self.last_number = came.taken.number;
        Ok(())
    }
}

/// Why the camera is not open.
enum Opening {
    Lost(&'static str, Loss),
    NoCamera(ZividFault),
}

/// How a worker was lost.
enum Loss {
    /// It had ended already.
    Ended(String),
    /// It closed its end of the socket.
    HungUp,
    /// It does not answer.
    Stalled(Duration),
    /// What it says cannot be read.
    Damaged(String),
}

impl Loss {
    fn of(error: WireError, waited: Duration) -> Self {
        match error {
            WireError::Ended | WireError::Cut { .. } => Loss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::BrokenPipe => Loss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::ConnectionReset => Loss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::TimedOut => Loss::Stalled(waited),
            WireError::Stalled { .. } => Loss::Stalled(waited),
            other => Loss::Damaged(other.to_string()),
        }
    }
}

fn foreign(during: &'static str, answer: &Answer) -> Opening {
    Opening::Lost(during, Loss::Damaged(name(answer)))
}

fn name(answer: &Answer) -> String {
    match answer {
        Answer::Words(words) => format!("it answered something else, {words:?}"),
        Answer::Scan(..) => "it answered by a 3D shot".to_owned(),
        Answer::Picture(..) => "it answered by a picture".to_owned(),
    }
}
