//! The people who send requests: one who runs cycles as the manual describes, and others who send any requests in
//! between.
//!
//! A world also checks the state machine here, whose state is shown each time the loop fetches the next request.

use super::desk::{ANOTHER_PERSON, Desk, OPERATOR, Shown};
use super::disk;
use super::fixture::Fixture;
use super::in_time::InTime;
use super::inside::{Inside, Shared};
use super::judges;
use super::sabotage::Sabotage;
use super::script::{self, Press};
use panelprep::cycle::{self, At, Cause, Id, Robot, State, Trouble, Why};
use panelprep::daemon::{LoopEvent, Port, Request, RequestAnswer, RequestCommand, RequestKind};
use panelprep::record::{ANOTHER_PART_TEXT, CycleId, LostPasses, RequestedAction};
use panelprep::supervision::{ThreadFailure, ThreadFault};
use panelprep::verdict::Verdict;
use std::collections::VecDeque;
use std::path::Path;

/// Interval at which a person looks at the cell, ms.
const POLL_INTERVAL_MS: u64 = 200;
/// Duration of a computation, and below it the interval at which the next picture of a film is checked, ms.
const COMPUTATION_MS: u64 = 120;
const PICTURE_POLL_INTERVAL_MS: u64 = 60;
/// Maximum time from the end of all faults until the cell has begun a new cycle, ms.
const RECOVERY_MS: u64 = 60_000;
/// Minimum distance of the tip from the panel from which the arm may move to its park pose from anywhere, mm: the 40 mm
/// of the path check plus the extent of the tool's body beside its tip.
const BODY_CLEAR_MM: f64 = 160.0;
/// Distance of the tip from the panel below which a person must jog the arm away, mm.
const MIN_DISTANCE_WITHOUT_JOG_MM: f64 = 100.0;
/// Time after which a wrong report has no further effect, ms.
const WRONG_REPORT_EFFECT_MS: u64 = 1_000;
/// Time for the effect of the last fault before all faults are ended, even if all cycles have ended, ms.
pub const AFTERMATH_MS: u64 = 5_000;
/// Maximum number of steps by which a second screen is outdated.
const MAX_STEPS_BEHIND: usize = 64;
/// Maximum number of attempts to continue a held cycle.
const MAX_ATTEMPTS: u32 = 3;

/// The aim of the people in the present process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aim {
    /// To run this number of cycles while faults are injected.
    Cycles(u64),
    /// To run one more cycle after all faults have ended: to its end if `whole` is set, otherwise to its first phase.
    Recover { whole: bool },
    /// The person leaves.
    Leave,
}

/// All people who send requests, in all processes of a world.
pub struct People {
    world: Shared,
    /// The present aim.
    pub aim: Aim,
    /// Time since which all faults have ended, ms.
    pub mended_ms: u64,
    /// Whether the cycle after all faults is run to its end.
    is_whole: bool,
    /// Virtual time after which the world ends in any case, ms.
    longest_ms: u64,
    looked_ms: u64,
    held: u32,
    /// Cycles that ended.
    ended: u64,
    /// Number of cycles that had begun when the faults ended.
    begun_before: u64,
    /// The queue and the handler of the present process.
    desk: Option<Desk>,
    /// Whether a person has requested the end of this process.
    has_left: bool,
    working: Option<(Id, u64)>,
    /// Whether the present cycle began after all faults had ended.
    is_untroubled: bool,
    /// Whether the present cycle began with the tool's body so near to the panel that a path check may require a jog.
    is_body_near: bool,
    /// Whether such a cycle was aborted and the cause is not known yet.
    is_cause_due: bool,
    /// The checks that the state machine performs its actions in time.
    in_time: InTime,
    /// Whether the people dry a held panel before they try other requests.
    pub dries: bool,
    /// A person's request for an end, and the time at which the state machine accepted it.
    pub stopping: Option<(cycle::Request, u64)>,
    /// Number of times a person jogged the arm away from the panel since all faults ended.
    taken_away: u32,
    /// The contents of a second screen, the newest last; they are kept when a process ends.
    shown: VecDeque<Shown>,
}

impl People {
    /// Returns the people of this world.
    pub fn new(world: Shared, (cycles, is_whole): (u64, bool), longest_ms: u64) -> Self {
        People {
            world,
            aim: Aim::Cycles(cycles),
            mended_ms: 0,
            is_whole,
            longest_ms,
            looked_ms: 0,
            held: 0,
            ended: 0,
            begun_before: 0,
            desk: None,
            has_left: false,
            working: None,
            is_untroubled: false,
            is_body_near: false,
            is_cause_due: false,
            in_time: InTime::default(),
            dries: false,
            stopping: None,
            taken_away: 0,
            shown: VecDeque::new(),
        }
    }

    /// Discards the earlier requests, which a new process does not know.
    pub fn forget(&mut self) {
        (self.desk, self.has_left) = (None, false);
        (self.working, self.stopping) = (None, None);
        self.in_time = InTime::default();
    }

    /// Starts a process on this store; `left` is the cycle that an earlier process did not end.
    pub fn begin(&mut self, store: &Path, left: Option<CycleId>) {
        self.desk = Some(Desk::new(store, left));
    }

    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let Some(mut desk) = self.desk.take() else { return Ok(None) };
        let request = self.next_at(&mut desk, state);
        self.desk = Some(desk);
        request
    }

    fn next_at(&mut self, desk: &mut Desk, state: &State) -> Result<Option<Request>, ThreadFault> {
        let mut world = self.world.lock();
        world.comes_to(state.at);
        judges::check_state(&mut world, state, &mut self.stopping);
        self.in_time.look(&mut world, state);
        let now_ms = world.now_ms();
        if let Aim::Cycles(cycles) = self.aim {
            let is_enough =
                self.ended >= cycles && !world.is_troubled() && now_ms >= world.struck_ms + AFTERMATH_MS;
            let is_over = is_enough || !world.may_strike();
            if is_over || now_ms >= self.longest_ms {
                world.mend();
                (self.aim, self.mended_ms) = (Aim::Recover { whole: self.is_whole }, now_ms);
                self.begun_before = world.counts.cycles;
            }
        }
        self.recovers(&mut world, state);
        if now_ms > 2 * self.longest_ms + 2 * RECOVERY_MS {
            let (at, aim, troubled) = (state.at, self.aim, world.is_troubled());
            world.wrong("end", format!("the world does not end: {at:?}, {aim:?}, troubled {troubled}"));
        }
        while let Some(press) = world.pressed.pop_front() {
            whats(press, world.stated()).into_iter().for_each(|what| desk.send_request(ANOTHER_PERSON, what));
        }
        let now = Shown::from_state(state);
        if self.shown.back() != Some(&now) {
            self.shown.push_back(now);
            self.shown.drain(..self.shown.len().saturating_sub(MAX_STEPS_BEHIND));
        }
        while let Some((press, back)) = world.screens.pop_front() {
            let at = self.shown.len().saturating_sub(1 + back as usize);
            if let Some(shown) = self.shown.get(at) {
                let carries = world.sabotage != Some(Sabotage::NoStep);
                script::requests(press)
                    .into_iter()
                    .for_each(|request| desk.send_decision(request, *shown, carries));
            }
        }
        let stated = world.stated();
        let away_until_ms = world.away_until_ms;
        drop(world);
        if desk.is_free() && now_ms >= away_until_ms.max(self.looked_ms + POLL_INTERVAL_MS) {
            self.looked_ms = now_ms;
            if let Some(what) = self.usual(state, stated) {
                let is_leave = matches!(what, RequestKind::Leave);
                // A second request to leave would abort the cycle.
                if !(is_leave && std::mem::replace(&mut self.has_left, true)) {
                    desk.send_request(OPERATOR, what);
                }
            }
        }
        if state.at.is_at_rest() && std::mem::take(&mut self.is_cause_due) && !asks_for_a_jog(state) {
            judges::ends_by_itself(&mut self.world.lock(), Verdict::Aborted);
        }
        let request = desk.next(state)?;
        if let Some(request) = &request {
            self.notes(&request.what, state, now_ms);
        }
        let mut world = self.world.lock();
        world.counts.judged("requests");
        (0..std::mem::take(&mut desk.decided)).for_each(|_| world.counts.judged("a stale decision does nothing"));
        if let Some(wrong) = desk.wrong.take() {
            world.wrong("requests", wrong);
        }
        Ok(request)
    }

    /// Checks that, after all faults have ended, clear, reset and start lead to a new cycle within a time limit.
    fn recovers(&self, world: &mut Inside, state: &State) {
        if !matches!(self.aim, Aim::Recover { .. }) || world.counts.cycles > self.begun_before {
            return;
        }
        world.counts.judged("liveness");
        let begun_ms = self.mended_ms.max(world.lasts_until_ms);
        if world.now_ms() > begun_ms + RECOVERY_MS {
            let (at, robot) = (state.at, state.facts.robot);
            world.wrong(
                "liveness",
                format!("no cycle {RECOVERY_MS} ms after all was mended: {at:?}, robot {robot:?}"),
            );
        }
    }

    fn notes(&mut self, what: &RequestKind, state: &State, now_ms: u64) {
        if let RequestKind::Table(request @ (cycle::Request::Stop | cycle::Request::Abort)) = what
            && !state.at.is_at_rest()
        {
            self.stopping.get_or_insert((*request, now_ms));
        }
    }

    /// Returns the request of a person who follows the manual.
    fn usual(&mut self, state: &State, stated: Stated) -> Option<RequestKind> {
        let is_ready = state.facts.robot == Robot::Ready;
        let table = |request| Some(RequestKind::Table(request));
        let has_recovered = self.has_recovered(state);
        if matches!(self.aim, Aim::Recover { .. }) && has_recovered {
            self.aim = Aim::Leave;
        }
        match (self.aim, state.at) {
            (Aim::Leave, At::Held(_)) => table(cycle::Request::Stop),
            (Aim::Leave, at) if at.is_at_rest() => Some(RequestKind::Leave),
            (Aim::Leave, At::Stopping { .. } | At::Aborting { .. } | At::Clearing { .. }) => None,
            (Aim::Leave, _) => table(cycle::Request::Stop),
            // A cycle that was in progress when the faults ended is stopped.
            (Aim::Recover { .. }, At::Execute(_) | At::Held(_) | At::Unholding { .. } | At::Starting)
                if self.world.lock().counts.cycles == self.begun_before =>
            {
                table(cycle::Request::Stop)
            }
            (_, At::Stopped | At::Complete { .. }) if is_ready => table(cycle::Request::Reset),
            (_, At::Idle) if is_ready => Some(begin(stated)),
            (_, At::Aborted { cause }) if is_ready => {
                // The arm is near the panel: the message requires the person to jog it away.
                if cause == Cause::Trouble(Trouble::Gate) {
                    self.world.lock().jogs_to_park();
                    self.taken_away += u32::from(matches!(self.aim, Aim::Recover { .. }));
                }
                table(cycle::Request::Clear)
            }
            (_, At::Held(hold)) if is_ready => {
                self.held += 1;
                if self.held > MAX_ATTEMPTS {
                    self.held = 0;
                    return table(cycle::Request::Stop);
                }
                table(match hold.why {
                    Why::Review => cycle::Request::Accept,
                    Why::NotVerified | Why::Drying => cycle::Request::Unhold { dried: true },
                    _ => cycle::Request::Unhold { dried: self.dries || self.held > 1 },
                })
            }
            _ => None,
        }
    }

    fn has_recovered(&self, state: &State) -> bool {
        let has_begun = self.world.lock().counts.cycles > self.begun_before;
        match self.aim {
            Aim::Recover { whole: true } => {
                // A cycle that only detected that the arm is at an unknown pose is not counted as the new cycle.
                let is_next = asks_for_a_jog(state) && self.taken_away < MAX_ATTEMPTS;
                has_begun && state.at.is_at_rest() && !state.job.running && !is_next
            }
            Aim::Recover { whole: false } => {
                has_begun && matches!(state.at, At::Execute(_) | At::Completing { .. } | At::Complete { .. })
            }
            _ => false,
        }
    }

    fn on_news(&mut self, news: &LoopEvent) {
        match news {
            LoopEvent::Begun(..) => {
                let mut world = self.world.lock();
                world.counts.cycles += 1;
                (world.is_another_part, world.states_lost_passes) = (false, false);
                // If the arm is near the panel at a pose at which no path ended, a person must jog it away.
                let is_calm = world.now_ms() >= world.lasts_until_ms + WRONG_REPORT_EFFECT_MS
                    && !world.is_troubled()
                    && !world.lingers
                    && world.height_mm() > MIN_DISTANCE_WITHOUT_JOG_MM;
                self.is_untroubled = self.aim == Aim::Recover { whole: true } && is_calm;
                self.is_body_near = world.height_mm() <= BODY_CLEAR_MM;
            }
            LoopEvent::Concluded(verdict) => {
                self.held = 0;
                self.ended += 1;
                let mut world = self.world.lock();
                // A failed part is often taken out, but not always.
                world.is_another_part |= *verdict == Verdict::Fail && self.ended.is_multiple_of(2);
                if std::mem::take(&mut self.is_untroubled) {
                    self.is_cause_due = self.is_body_near && *verdict == Verdict::Aborted;
                    if !self.is_cause_due {
                        judges::ends_by_itself(&mut world, *verdict);
                    }
                }
                *world.counts.verdicts.entry(verdict.keyword()).or_default() += 1;
                judges::concluded(&mut world, *verdict);
            }
            LoopEvent::Unable(reasons) => {
                tracing::debug!("unable: {reasons:?}");
                let mut world = self.world.lock();
                if reasons.iter().any(|reason| reason.message.contains("--lost-passes")) {
                    // As the message requires: another part, or the number of the lost passes.
                    let is_another = world.counts.restores.is_multiple_of(2);
                    (world.is_another_part, world.states_lost_passes) = (is_another, !is_another);
                    world.counts.judged("a restored store asks for the count");
                }
            }
            _ => {}
        }
    }

    /// Returns whether the loop receives a result: a result is available after its computing time has passed.
    fn admit(&mut self, id: Id) -> bool {
        let world = self.world.lock();
        let now_ms = world.now_ms();
        let late_ms = world.cameras.iter().flatten().filter(|(_, until_ms)| now_ms < *until_ms);
        let late_ms: u64 = late_ms
            .map(|(harm, _)| match harm {
                script::CameraHarm::Late(ms) => *ms,
                _ => 0,
            })
            .sum();
        match self.working {
            Some((under_way, due_ms)) if under_way == id => {
                if now_ms >= due_ms {
                    self.working = Some((id, now_ms + PICTURE_POLL_INTERVAL_MS + late_ms));
                    return true;
                }
                false
            }
            _ => {
                self.working = Some((id, now_ms + COMPUTATION_MS + late_ms));
                false
            }
        }
    }
}

impl Port<RequestCommand> for People {
    fn perform(&mut self, command: RequestCommand) -> RequestAnswer {
        match command {
            // A process without its disk has ended, even if the loop has not detected this yet; and the world ends when
            // a check has found a violation.
            RequestCommand::Next(_) if disk::is_over() || self.world.lock().violation.is_some() => {
                let thread = "the process".to_owned();
                RequestAnswer::Next(Err(ThreadFault { thread, failure: ThreadFailure::Ended }))
            }
            RequestCommand::Next(state) => RequestAnswer::Next(self.next(&state)),
            RequestCommand::LetsIn(id) => RequestAnswer::LetsIn(self.admit(id).then_some(id)),
            RequestCommand::Publish(news) => {
                self.on_news(&news);
                if let Some(desk) = &mut self.desk {
                    desk.on_news(news);
                }
                RequestAnswer::Done
            }
        }
    }
}

/// Returns whether a path check has aborted the cycle because the arm is at an unknown pose near the panel.
fn asks_for_a_jog(state: &State) -> bool {
    state.at == At::Aborted { cause: Cause::Trouble(Trouble::Gate) }
}

/// Statements of people at a start about the part.
#[derive(Debug, Clone, Copy)]
pub struct Stated {
    pub is_another_part: bool,
    pub lost_passes: Option<usize>,
}

impl Inside {
    fn stated(&self) -> Stated {
        let lost_passes = self.states_lost_passes.then_some(self.lost_passes);
        Stated { is_another_part: self.is_another_part, lost_passes }
    }
}

fn begin(Stated { is_another_part, lost_passes }: Stated) -> RequestKind {
    let mut prepared = Fixture::shared().prepared();
    if is_another_part {
        prepared.start.file_texts.push((ANOTHER_PART_TEXT.to_owned(), "yes".to_owned()));
    }
    if let Some(passes) = lost_passes {
        prepared.start.file_texts.push((LostPasses::FILE.to_owned(), format!("passes = {passes}\n")));
    }
    RequestKind::Begin(Box::new(prepared))
}

fn whats(press: Press, stated: Stated) -> Vec<RequestKind> {
    match press {
        Press::Start => vec![begin(stated)],
        Press::NewDisc => vec![RequestKind::NewDisc],
        Press::Leave => vec![RequestKind::Leave],
        Press::Unprepared => {
            let wanted = RequestedAction::Start { recipe: "none.toml".to_owned() };
            vec![RequestKind::Refused { wanted, reasons: vec![] }]
        }
        Press::Everything => script::requests(press)
            .into_iter()
            .map(RequestKind::Table)
            .chain([begin(stated), RequestKind::NewDisc])
            .collect(),
        press => script::requests(press).into_iter().map(RequestKind::Table).collect(),
    }
}
