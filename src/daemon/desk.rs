//! The service's desk: what people, signals and systemd ask of the loop, and what they are told.
//!
//! It is called by the loop each time it comes round, so what it sends systemd (`WATCHDOG=1`) proves that the loop
//! works. SIGTERM or SIGINT is a stop, a second one an abort; the service leaves from Stopped or Aborted only.

use super::ports::{Ask, Order, Requests};
use super::protocol::{Exit, Reply};
use super::replay::{Recording, Taping};
use super::words;
use crate::cycle::{At, Refusal, Request, State};
use crate::record::CycleId;
use crate::tape::Begin;
use crate::verdict::{Reason, Verdict};
use sd_notify::NotifyState;
use std::sync::mpsc::{Receiver, Sender, SyncSender};
use std::time::{Duration, Instant};

/// What comes to the desk.
#[derive(Debug)]
pub enum Letter {
    /// Somebody asks and waits for the answer.
    Asked {
        /// What.
        asked: Asked,
        /// Where the answer goes.
        reply: SyncSender<Reply>,
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
        match self {
            Asked::State => f.write_str("state"),
            Asked::For(request) => write!(f, "{request:?}"),
            Asked::NewDisc => f.write_str("new disc"),
            Asked::Begin(order) => write!(f, "start of {}", order.task.recipe.panel()),
        }
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

/// At rest nothing is urgent: so long the loop waits for a letter.
const REST: Duration = Duration::from_millis(20);

/// The desk.
#[derive(Debug)]
pub struct Desk {
    letters: Receiver<Letter>,
    /// Who asked last and is not answered yet.
    waiting: Option<SyncSender<Reply>>,
    signals: u8,
    /// How much of the signals the table was asked.
    obeyed: u8,
    told: Option<At>,
    /// How often systemd wants to hear from the loop, and when it last did.
    watchdog: Option<(Duration, Instant)>,
    cycle: Option<CycleId>,
    verdict: Option<Verdict>,
    /// Who writes the page of a cycle that has ended, and the cycle whose page is due once the cell rests.
    pages: Sender<EndedCycle>,
    ended: Option<CycleId>,
    taping: Taping,
    /// What was last found wrong; what was, before something new was asked.
    noted: Vec<Reason>,
    set_aside: Vec<Reason>,
    /// As the loop last showed it.
    state: State,
}

impl Desk {
    /// A desk where these letters come, and that tells `pages` which cycles have ended; `left` is the one that an
    /// earlier process did not end. It tells how cycles are recorded by `taping`.
    pub fn new(
        letters: Receiver<Letter>,
        pages: Sender<EndedCycle>,
        left: Option<CycleId>,
        taping: Taping,
    ) -> Self {
        let watchdog = sd_notify::watchdog_enabled().map(|every| (every / 2, Instant::now()));
        Desk {
            letters,
            waiting: None,
            signals: 0,
            obeyed: 0,
            told: None,
            watchdog,
            cycle: left,
            verdict: None,
            pages,
            ended: None,
            taping,
            noted: Vec::new(),
            set_aside: Vec::new(),
            state: State::NEW,
        }
    }

    fn reply(&self, answer: Exit, reasons: Vec<Reason>, state: &State) -> Reply {
        let phase = match state.at {
            At::Execute(phase) => Some(words::phase(phase).to_owned()),
            _ => None,
        };
        Reply {
            answer,
            state: Some(state.at.word().to_owned()),
            phase,
            epoch: Some(state.epoch),
            cycle_id: self.cycle.map(|cycle| cycle.0),
            verdict: self.verdict,
            recording: self.taping.told(),
            reasons,
        }
    }

    /// Why the cell is in this state, and what was last found wrong.
    fn reasons(&self, state: &State) -> Vec<Reason> {
        words::why(state).into_iter().chain(self.noted.iter().cloned()).collect()
    }

    fn answer(&mut self, answer: Exit, reasons: Vec<Reason>, state: &State) {
        if let Some(waiting) = self.waiting.take() {
            // Whoever hung up does not want to know.
            let _ = waiting.send(self.reply(answer, reasons, state));
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
}

impl Requests for Desk {
    fn next(&mut self, state: &State) -> Ask {
        self.state = *state;
        // What was asked when the loop last came round was taken: else it would be answered by now.
        self.answer(Exit::Done, self.reasons(state), state);
        self.tell(state);
        if let Some(id) = self.ended.take_if(|_| state.at.rests()) {
            // Without a writer the record stays; its page can be made of it.
            let _ = self.pages.send(EndedCycle { id, recording: self.taping.take() });
        }
        if let Some(ask) = self.leaving(state) {
            return ask;
        }
        let letter = match state.at.rests() {
            true => self.letters.recv_timeout(REST).ok(),
            false => self.letters.try_recv().ok(),
        };
        match letter {
            None => Ask::Nothing,
            Some(Letter::Signal) => {
                self.signal();
                Ask::Nothing
            }
            Some(Letter::Asked { asked, reply }) => {
                self.waiting = Some(reply);
                match asked {
                    Asked::State => {
                        self.answer(Exit::Done, self.reasons(state), state);
                        Ask::Nothing
                    }
                    Asked::For(request) => {
                        if matches!(
                            request,
                            Request::Reset | Request::Clear | Request::Unhold { .. } | Request::Accept
                        ) {
                            self.set_aside = std::mem::take(&mut self.noted);
                        }
                        Ask::For(request)
                    }
                    Asked::Begin(order) => Ask::Begin(order),
                    Asked::NewDisc => Ask::NewDisc,
                }
            }
        }
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
mod tests {
    use super::*;
    use crate::cycle::{Event, Phase, Report, Robot, step};
    use std::sync::mpsc;

    fn desk() -> (Sender<Letter>, Desk) {
        let (letters, taken) = mpsc::channel();
        (letters, Desk::new(taken, mpsc::channel().0, None, off()))
    }

    fn off() -> Taping {
        Taping::new("store".as_ref(), true)
    }

    fn at(at: At) -> State {
        State { at, ..step(State::NEW, Event::Told(Report::Robot(Robot::Ready))).0 }
    }

    fn asks(ask: &Ask) -> Option<Request> {
        match ask {
            Ask::For(request) => Some(*request),
            _ => None,
        }
    }

    /// Two signals: a stop, an abort; a third asks nothing. The service leaves once the cell is at rest.
    #[test]
    fn signals_stop_then_abort_and_leave_at_rest() {
        let (letters, mut desk) = desk();
        let busy = at(At::Execute(Phase::Inspect));
        assert_eq!(asks(&desk.next(&busy)), None);
        for wanted in [Some(Request::Stop), Some(Request::Abort), None] {
            letters.send(Letter::Signal).expect("sent");
            assert!(matches!(desk.next(&busy), Ask::Nothing), "it is read");
            assert_eq!(asks(&desk.next(&busy)), wanted);
        }
        assert!(!matches!(desk.next(&at(At::Idle)), Ask::Leave), "idle is not an end");
        assert!(matches!(desk.next(&at(At::Stopped)), Ask::Leave));
    }

    /// Its park move is still to come when the verdict is known.
    #[test]
    fn a_page_is_due_once_the_cell_rests() {
        let (_letters, taken) = mpsc::channel();
        let (tell, pages) = mpsc::channel();
        let mut desk = Desk::new(taken, tell, None, off());
        desk.begun(CycleId(7), Begin::Boot);
        desk.concluded(Verdict::Fail);
        desk.next(&at(At::Completing { verdict: Verdict::Fail }));
        assert!(pages.try_recv().is_err());
        for _ in 0..2 {
            desk.next(&at(At::Complete { verdict: Verdict::Fail }));
        }
        assert_eq!(pages.try_iter().map(|ended| ended.id).collect::<Vec<_>>(), [CycleId(7)], "once");
    }

    #[test]
    fn each_letter_has_one_answer() {
        let (letters, mut desk) = desk();
        let (idle, busy) = (at(At::Idle), at(At::Execute(Phase::Wet)));
        let ask = |asked| {
            let (reply, answer) = mpsc::sync_channel(1);
            letters.send(Letter::Asked { asked, reply }).expect("sent");
            answer
        };
        let state = ask(Asked::State);
        assert!(matches!(desk.next(&busy), Ask::Nothing));
        let reply = state.try_recv().expect("answered");
        assert_eq!((reply.answer, reply.phase.as_deref()), (Exit::Done, Some("wet")));

        let taken = ask(Asked::For(Request::Hold));
        assert_eq!(asks(&desk.next(&busy)), Some(Request::Hold));
        assert!(taken.try_recv().is_err(), "not before the table has taken it");
        desk.next(&busy);
        assert_eq!(taken.try_recv().expect("answered").answer, Exit::Done);

        desk.noted(&[Reason::new("film", "it broke")]);
        let refused = ask(Asked::For(Request::Reset));
        assert_eq!(asks(&desk.next(&idle)), Some(Request::Reset));
        desk.refused(Request::Reset, Refusal::NotNow);
        let reply = refused.try_recv().expect("answered");
        assert_eq!((reply.answer, &*reply.reasons[0].code), (Exit::Refused, "not_now"));
        assert_eq!(desk.noted.len(), 1, "a refusal changes nothing");
        desk.next(&idle);
        assert!(refused.try_recv().is_err(), "answered once");
    }
}
