//! The service's desk: what people, signals and systemd ask of the loop, and what they are told.
//!
//! It is called by the loop each time it comes round, and asks the supervisor about the other threads, so what it sends
//! systemd (`WATCHDOG=1`) proves that all of them work. SIGTERM or SIGINT is a stop, a second one an abort; the service leaves from Stopped or Aborted only.

use super::caller::Caller;
use super::lending::SharedCameras;
use super::letters::Inbox;
use super::ports::{Ask, Order, Requests};
use super::protocol::{Exit, Reply};
use super::replay::{Recording, Taping};
use super::{who, words};
use crate::cycle::{At, Path as PathKind, Phase, Refusal, Request, State};
use crate::record::{CycleId, Front, Wanted, Who};
use crate::supervision::{Supervised, Supervisor, supervised};
use crate::tape::Begin;
use crate::verdict::{Reason, Verdict};
use sd_notify::NotifyState;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// What comes to the desk.
#[derive(Debug)]
pub enum Letter {
    /// Somebody asks and waits for the answer.
    Asked {
        /// What.
        asked: Asked,
        /// Who.
        who: Caller,
        /// Where the answer goes.
        reply: oneshot::Sender<Reply>,
    },
    /// Somebody asked and was refused already, such as a start by a recipe with mistakes; it is kept.
    Refused {
        /// What.
        wanted: Wanted,
        /// Who.
        who: Caller,
        /// Why.
        reasons: Vec<Reason>,
    },
    /// SIGTERM or SIGINT.
    Signal,
}

/// What somebody asks.
pub enum Asked {
    /// How things stand.
    State,
    /// This.
    For(Request),
    /// A cycle.
    Begin(Box<Order>),
    /// A new disc was mounted.
    NewDisc,
}

impl std::fmt::Debug for Asked {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&words::asked(self))
    }
}

/// A cycle that has ended.
#[derive(Debug)]
pub struct EndedCycle {
    /// Which.
    pub id: CycleId,
    /// Its recording, which may still be written.
    pub recording: Option<Recording>,
}

/// What is beside the loop, as far as the desk has to do with it.
#[derive(Debug)]
pub struct Beside {
    /// How cycles are recorded.
    pub taping: Taping,
    /// Who asks all threads whether they work.
    pub supervisor: Supervisor,
    /// Who writes the page of a cycle that has ended.
    pub pages: Sender<EndedCycle>,
    /// The page that was written last.
    pub written: WrittenPage,
    /// The cameras, which are lent while the cell rests.
    pub cameras: Option<SharedCameras>,
}

/// The page that was written last, and whose it is. Clones are the same one.
#[derive(Debug, Clone, Default)]
pub struct WrittenPage(Arc<Mutex<Option<(CycleId, PathBuf)>>>);

impl WrittenPage {
    /// This cycle's page was written.
    pub fn is(&self, cycle: CycleId, page: &Path) {
        *self.lock() = Some((cycle, page.to_owned()));
    }

    fn of(&self, cycle: CycleId) -> Option<PathBuf> {
        self.lock().as_ref().filter(|(written, _)| *written == cycle).map(|(_, page)| page.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Option<(CycleId, PathBuf)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The phase inside Execute, and the one in which a cycle that is held goes on.
fn phase(at: At) -> Option<Phase> {
    match at {
        At::Execute(phase) => Some(phase),
        At::Holding(hold) | At::Held(hold) => Some(hold.resume),
        At::Unholding { resume, .. } => Some(resume),
        _ => None,
    }
}

/// At rest nothing is urgent: so long the loop waits for a letter.
const REST: Duration = Duration::from_millis(20);

/// As many are told the state in one round of the loop.
const MOST_ANSWERED: usize = 64;

/// The desk.
#[derive(Debug)]
pub struct Desk {
    letters: Inbox,
    /// Who asked last and is not answered yet.
    waiting: Option<oneshot::Sender<Reply>>,
    /// Who asked what was handed to the loop last.
    who: Who,
    signals: u8,
    /// How much of the signals the table was asked.
    obeyed: u8,
    told: Option<At>,
    /// How often systemd wants to hear from the loop, and when it last did.
    watchdog: Option<(Duration, Instant)>,
    /// What is beside the loop; and the loop's own sign of life.
    beside: Beside,
    sign: Supervised,
    cycle: Option<CycleId>,
    verdict: Option<Verdict>,
    /// The panel of the cycle; of the order that is being taken.
    panel: Option<String>,
    ordered: Option<String>,
    /// Seconds of the film that is under way.
    film_s: Option<f64>,
    /// What was done, for who asked for it.
    done: Option<String>,
    /// The cycle whose page is due once the cell rests.
    ended: Option<CycleId>,
    /// What was last found wrong; what was, before something new was asked.
    noted: Vec<Reason>,
    set_aside: Vec<Reason>,
    /// As the loop last showed it.
    state: State,
}

impl Desk {
    /// A desk where these letters come; `left` is the cycle that an earlier process did not end. It tells systemd that the
    /// loop works while the supervisor finds that all threads do.
    pub fn new(letters: Inbox, left: Option<CycleId>, beside: Beside) -> Self {
        let (sign, _) = supervised("loop", Duration::MAX);
        let watchdog = sd_notify::watchdog_enabled().map(|every| (every / 2, Instant::now()));
        Desk {
            letters,
            waiting: None,
            who: Who::by(Front::Program),
            signals: 0,
            obeyed: 0,
            told: None,
            watchdog,
            beside,
            sign,
            cycle: left,
            verdict: None,
            panel: None,
            ordered: None,
            film_s: None,
            done: None,
            ended: None,
            noted: Vec::new(),
            set_aside: Vec::new(),
            state: State::NEW,
        }
    }

    fn reply(&self, answer: Exit, reasons: Vec<Reason>, state: &State) -> Reply {
        let counts = |path| matches!(path, PathKind::Contact | PathKind::Air);
        let path = state.intent.filter(|intent| counts(intent.motion.path));
        Reply {
            answer,
            state: Some(state.at.word().to_owned()),
            phase: phase(state.at).map(|phase| words::phase(phase).to_owned()),
            panel: self.panel.clone(),
            pass: self.cycle.map(|_| state.job.pass),
            film_s: self.film_s.filter(|_| state.at == At::Execute(Phase::Inspect)),
            waypoint: path.map(|intent| intent.done),
            of: path.map(|intent| intent.motion.waypoints),
            page: self.cycle.and_then(|cycle| self.beside.written.of(cycle)),
            axes_deg: self.beside.cameras.as_ref().and_then(SharedCameras::stands).map(|axes| axes.degrees()),
            epoch: Some(state.epoch),
            cycle_id: self.cycle.map(|cycle| cycle.0),
            verdict: self.verdict,
            recording: self.beside.taping.told(),
            done: None,
            reasons,
        }
    }

    /// Why the cell is in this state, and what was last found wrong.
    fn reasons(&self, state: &State) -> Vec<Reason> {
        words::why(state).into_iter().chain(self.noted.iter().cloned()).collect()
    }

    fn answer(&mut self, answer: Exit, reasons: Vec<Reason>, state: &State) {
        let done = self.done.take();
        if let Some(waiting) = self.waiting.take() {
            // Whoever hung up does not want to know.
            let _ = waiting.send(Reply { done, ..self.reply(answer, reasons, state) });
        }
    }

    /// Tells systemd; without it nobody listens.
    fn notify(states: &[NotifyState<'_>]) {
        if let Err(error) = sd_notify::notify(states) {
            tracing::warn!("systemd cannot be told: {error}");
        }
    }

    fn tell(&mut self, state: &State) {
        if self.told != Some(state.at) {
            let status = match self.cycle {
                Some(cycle) => format!("{}; cycle {cycle}, epoch {}", words::place(state.at), state.epoch),
                None => words::place(state.at),
            };
            let first = self.told.replace(state.at).is_none();
            let ready = first.then_some(NotifyState::Ready);
            let states: Vec<_> = ready.into_iter().chain([NotifyState::Status(&status)]).collect();
            Self::notify(&states);
        }
        if let Some((every, last)) = &mut self.watchdog
            && last.elapsed() >= *every
        {
            *last = Instant::now();
            Self::notify(&[NotifyState::Watchdog]);
        }
    }

    /// A letter that the loop is to act on.
    fn take(&mut self, asked: Asked, reply: oneshot::Sender<Reply>) -> Ask {
        self.waiting = Some(reply);
        match asked {
            Asked::State => Ask::Nothing,
            Asked::For(request) => {
                // A refusal brings it back.
                self.set_aside = self.noted.clone();
                if matches!(request, Request::Reset | Request::Clear | Request::Unhold { .. } | Request::Accept) {
                    self.noted.clear();
                }
                Ask::For(request)
            }
            Asked::Begin(order) => {
                self.ordered = Some(order.task.recipe.panel().to_owned());
                Ask::Begin(order)
            }
            Asked::NewDisc => Ask::NewDisc,
        }
    }

    /// What the signals so far ask for.
    fn leaving(&mut self, state: &State) -> Option<Ask> {
        if self.signals == 0 {
            return None;
        }
        if matches!(state.at, At::Stopped | At::Aborted { .. }) {
            return Some(Ask::Leave);
        }
        let wanted = self.signals.min(2);
        if self.obeyed >= wanted {
            return None;
        }
        self.obeyed = wanted;
        self.who = Who::by(Front::Signal);
        Some(Ask::For(if wanted == 1 { Request::Stop } else { Request::Abort }))
    }

    fn signal(&mut self) {
        self.signals = self.signals.saturating_add(1);
        if self.signals == 1 {
            tracing::info!("a signal asks for a stop; a second one aborts");
            Self::notify(&[NotifyState::Stopping]);
        } else {
            tracing::warn!("another signal: abort");
        }
    }

    /// What is asked now.
    fn asked(&mut self, state: &State) -> Ask {
        self.state = *state;
        self.sign.works();
        if let Err(fault) = self.beside.supervisor.check() {
            return Ask::GiveUp(fault);
        }
        // What was asked when the loop last came round was taken: else it would be answered by now.
        self.answer(Exit::Done, self.reasons(state), state);
        self.tell(state);
        if let Some(id) = self.ended.take_if(|_| state.at.rests()) {
            // Without a writer the record stays; its page can be made of it.
            let _ = self.beside.pages.send(EndedCycle { id, recording: self.beside.taping.take() });
        }
        if let Some(ask) = self.leaving(state) {
            return ask;
        }
        let mut patience = if state.at.rests() { REST } else { Duration::ZERO };
        // All who ask for the state are answered in one round: they take no turns from those who ask for more.
        for _ in 0..MOST_ANSWERED {
            match self.letters.next(patience) {
                None => break,
                Some(Letter::Asked { asked: Asked::State, reply, .. }) => {
                    self.waiting = Some(reply);
                    self.answer(Exit::Done, self.reasons(state), state);
                    patience = Duration::ZERO;
                }
                Some(Letter::Signal) => {
                    self.signal();
                    break;
                }
                Some(Letter::Refused { wanted, who, reasons }) => {
                    self.who = who::at_the_socket(who);
                    return Ask::Refused(wanted, reasons);
                }
                Some(Letter::Asked { asked, who, reply }) => {
                    self.who = who::at_the_socket(who);
                    return self.take(asked, reply);
                }
            }
        }
        Ask::Nothing
    }
}

impl Requests for Desk {
    fn next(&mut self, state: &State) -> Ask {
        if let Some(cameras) = &self.beside.cameras {
            cameras.cell_is(state);
        }
        let ask = self.asked(state);
        if let (Some(cameras), Ask::For(_) | Ask::Begin(_)) = (&self.beside.cameras, &ask) {
            cameras.are_needed();
        }
        ask
    }

    fn who(&self) -> Who {
        self.who.clone()
    }

    fn refused(&mut self, request: Request, refusal: Refusal) {
        let state = self.state;
        let reason = words::refusal(request, refusal, &state);
        tracing::warn!("refused: {}", reason.message);
        let exit = match refusal {
            Refusal::NotNow | Refusal::Review => Exit::Refused,
            Refusal::Robot(_) | Refusal::Failed(_) => Exit::Fault,
        };
        if self.waiting.is_some() {
            self.noted = std::mem::take(&mut self.set_aside);
            self.answer(exit, vec![reason], &state);
        } else {
            // A reset that failed on its way.
            self.noted.insert(0, reason);
        }
    }

    fn unable(&mut self, reasons: Vec<Reason>) {
        let state = self.state;
        self.answer(Exit::Fault, reasons, &state);
    }

    fn begun(&mut self, cycle: CycleId, _: Begin) {
        self.noted.clear();
        (self.cycle, self.verdict) = (Some(cycle), None);
        (self.panel, self.film_s) = (self.ordered.take(), None);
    }

    fn filmed(&mut self, seconds: f64) {
        self.film_s = Some(seconds);
    }

    fn disc_mounted(&mut self) {
        self.done = Some("a new disc is mounted: its wear is counted from zero".to_owned());
    }

    fn concluded(&mut self, verdict: Verdict) {
        self.verdict = Some(verdict);
        self.ended = self.cycle;
    }

    fn noted(&mut self, reasons: &[Reason]) {
        self.noted = reasons.to_vec();
    }
}

#[cfg(test)]
mod tests;
